"""Comparison of linearised plant and design model: modes, frequency responses, error."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.gain_gen.models.linear_car import INPUTS, OUTPUTS, linear_car
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.world.linearise import IMU_LATERAL_ACCELERATION, Trim, find_trim, linearise
from canroll.plant_sim.world.modes import Mode, modes
from canroll.typing import Vector
from canroll.vehicles import Vehicle

FREQUENCIES = np.geomspace(0.1, 10.0, 81)
"""Where responses are computed and compared (Hz)."""

EXCITATIONS = ("moment", "steering")
"""Anti-roll moment on the body (N·m), road-wheel angle (rad)."""

MEASURED = {
    "roll_rate": ports.ROLL_RATE,
    "roll": ports.ROLL,
    "lateral_acceleration": ports.AY,
    "imu_lateral": IMU_LATERAL_ACCELERATION,
    "yaw_rate": ports.YAW_RATE,
}
"""Responses by name, and the plant's output slot: SI units; of the CG, and as the IMU feels it."""

_IGNORED = 1e-9
"""Effect of friction on rates and outputs, SI units per unit of friction, that counts as none."""

_NO_RESPONSE = 1e-13
"""Peak (SI units) that is the rounding of a response that the plant does not have."""

Responses = dict[str, dict[str, NDArray[np.complex128]]]
"""Complex response over :data:`FREQUENCIES` by excitation and by measured quantity."""


@dataclass(frozen=True, slots=True)
class LinearResponse:
    """A body linearised at a trim.

    Attributes:
        trim: trim of the linearisation.
        modes: modes of the body there, slowest first.
        plant: frequency responses of the body.
        design: those of the design model at the same trim; None if it has no such trim.
        why_not: reason if ``design`` is None.
    """

    trim: Trim
    modes: list[Mode]
    plant: Responses
    design: Responses | None
    why_not: str = ""

    @property
    def distance(self) -> dict[str, dict[str, float | None]] | None:
        """Largest error of the design model as a fraction of the plant's peak, by response.

        None for a response that the plant does not have; None altogether without a design model.
        """
        if self.design is None:
            return None
        return {
            excitation: {
                name: _distance(response, self.design[excitation][name])
                for name, response in responses.items()
            }
            for excitation, responses in self.plant.items()
        }


def _distance(plant: NDArray[np.complex128], design: NDArray[np.complex128]) -> float | None:
    peak = float(np.abs(plant).max())
    return float(np.abs(design - plant).max()) / peak if peak > _NO_RESPONSE else None


def linear_response(
    vehicle: Vehicle,
    body: Body,
    *,
    speed: float,
    lateral_acceleration: float = 0.0,
    friction: float = 1.0,
) -> LinearResponse:
    """Linearise ``body`` in a steady curve (m/s², to the left) at ``speed`` (m/s) and compare.

    Raises:
        CanrollError: there is no such curve, the body cannot be linearised, or friction has no
            effect on it.
    """
    trim = find_trim(
        vehicle,
        body,
        speed=speed,
        lateral_acceleration=lateral_acceleration,
        friction=friction,
    )
    plant = linearise(trim)
    effect = max(np.abs(plant.b[:, ports.FRICTION]).max(), np.abs(plant.d[:, ports.FRICTION]).max())
    if friction != 1.0 and effect < _IGNORED:
        raise CanrollError(
            f"--friction {friction:g} has no effect on {body.name} at this trim: its tyres "
            "are linear there; give a --lateral-acceleration, or another --plant"
        )
    rows = tuple(MEASURED.values())
    responses: Responses = {}
    for name in EXCITATIONS:
        curves = plant.response(FREQUENCIES, excitation(vehicle, name), rows)
        responses[name] = dict(zip(MEASURED, curves, strict=True))
    design, why_not = None, ""
    try:
        model = linear_car(
            vehicle, speed, lateral_acceleration=lateral_acceleration, friction=friction
        )
    except CanrollError as error:
        why_not = str(error)
    else:
        computed = model.response(2 * np.pi * FREQUENCIES).astype(np.complex128)
        design = {
            name: {
                measured: computed[:, OUTPUTS.index(measured), INPUTS.index(name)]
                for measured in MEASURED
            }
            for name in EXCITATIONS
        }
    return LinearResponse(trim, modes(plant), responses, design, why_not)


def excitation(vehicle: Vehicle, name: str) -> Vector:
    """Return one unit of an excitation in the plant's inputs (N_INPUTS,).

    A moment is applied as forces at the corners, split between the axles like their static load.
    """
    inputs = np.zeros(ports.N_INPUTS)
    if name == "steering":
        inputs[ports.STEER] = 1.0
        return inputs
    geometry = vehicle.geometry
    front = geometry.static_front_share / (2 * geometry.half_track_front)
    rear = (1 - geometry.static_front_share) / (2 * geometry.half_track_rear)
    inputs[ports.CORNER_FORCE : ports.CORNER_FORCE + 4] = front, -front, rear, -rear
    return inputs


def to_json(linear: LinearResponse) -> dict[str, Any]:
    """Return the object of ``canroll handling response --linear --json`` without the request."""
    trim = linear.trim
    answer: dict[str, Any] = {
        "steer_deg": float(np.degrees(trim.inputs[ports.STEER])),
        "roll_deg": float(np.degrees(trim.outputs[ports.ROLL])),
        "modes": [
            {
                "motion": mode.motion,
                "shares": dict(mode.shares),
                "frequency_hz": mode.frequency,
                "damping": mode.damping,
                "real": mode.pole.real,
                "imaginary": mode.pole.imag,
            }
            for mode in linear.modes
        ],
        "frequency_hz": FREQUENCIES.tolist(),
    }
    for name, responses in linear.plant.items():
        answer[name] = {
            measured: {
                "gain": np.abs(response).tolist(),
                "phase_deg": np.degrees(np.unwrap(np.angle(response))).tolist(),
            }
            for measured, response in responses.items()
        }
    answer["design_distance"] = linear.distance
    answer["no_design_model"] = linear.why_not or None
    return answer
