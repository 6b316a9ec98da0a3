"""An FMU as a plant body: ``--plant model.fmu``, or ``model.fmu#map.toml``."""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count
from math import cos, isfinite, nan, sin
from pathlib import Path

import numba
import numpy as np

from canroll.errors import CanrollError
from canroll.extensions.exchange.fmi import description, map_file
from canroll.extensions.exchange.fmi.map_file import PlantMap
from canroll.extensions.exchange.fmi.quantities import (
    AT_REST,
    INPUTS,
    NEUTRAL,
    OUTPUTS,
    RATES,
    SAME,
)
from canroll.extensions.exchange.fmi.session import FmuSession
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import ROLLOVER_ANGLE, WHEELS, Body, Outside
from canroll.plant_sim.kernels.jit import STEP_SIGNATURE, cfunc, function_at
from canroll.typing import Vector
from canroll.vehicles import Vehicle

SPEED_TOLERANCE = 0.02
"""Relative difference of the FMU's speed from the entry speed allowed at the start."""
BY_WHEEL = ("wheel_load", "travel", "wheel_speed", "wheel_height", "lateral_force")
"""Outputs that are NaN where the map does not have all four."""


@dataclass(slots=True)
class FmuDrive:
    """One vehicle on its way: its FMU, what it stands on, and how it ended."""

    name: str
    plant_map: PlantMap
    session: FmuSession
    speed: float
    steering_ratio: float
    half_tracks: tuple[float, float]
    last: dict[str, float] = field(default_factory=dict)
    failure: BaseException | None = None

    def step(self, inputs: Vector, outputs: Vector, dt: float) -> None:
        """Fill ``outputs`` after ``dt`` (s); 0: at the start."""
        given = self._given(inputs)
        if dt == 0.0:
            state: dict[str, float] | None = self.session.start(given)
        else:
            state = self.session.step(given)
        if state is None:
            return
        if dt == 0.0:
            self._check_speed(state["vx"])
            for name in lacking(self.plant_map):
                for wheel in WHEELS if name in BY_WHEEL else ():
                    outputs[OUTPUTS[f"{name}_{wheel}"][0]] = nan
                    if name == "travel":
                        outputs[OUTPUTS[f"travel_rate_{wheel}"][0]] = nan
        self._complete(state)
        self.last = state
        for name, value in state.items():
            outputs[OUTPUTS[name][0]] = value

    def _given(self, inputs: Vector) -> dict[str, float]:
        given = {name: float(inputs[place]) for name, (place, _) in INPUTS.items()}
        known = self.plant_map.given
        for name, value in given.items():
            if value != NEUTRAL.get(name, 0.0) and name not in known:
                raise CanrollError(
                    f"{self.name}: the run sets {name} to {value:.4g}, for which the map has no "
                    f'variable: add one to [inputs], or write ignored = ["{name}"] in '
                    f"{self.plant_map.path}"
                )
        given["steering_wheel_angle"] = given["steer"] * self.steering_ratio
        given["speed"] = self.speed
        for axle, half_track in zip(("front", "rear"), self.half_tracks, strict=True):
            left, right = given[f"corner_force_{axle}_left"], given[f"corner_force_{axle}_right"]
            given[f"roll_moment_{axle}"] = given[f"bar_moment_{axle}"] + half_track * (left - right)
        given["roll_moment"] = given["roll_moment_front"] + given["roll_moment_rear"]
        return given

    def _check_speed(self, speed: float) -> None:
        if abs(speed - self.speed) > SPEED_TOLERANCE * self.speed:
            raise CanrollError(
                f"{self.name}: starts at {3.6 * speed:.4g} km/h, the manoeuvre at "
                f"{3.6 * self.speed:.4g} km/h: set its start speed under [start] of "
                f'{self.plant_map.path} (VARIABLE = "speed"), or give --speed'
            )

    def _complete(self, state: dict[str, float]) -> None:
        """Add what the map does not have: rates as differences, motion that is none, verdicts."""
        step, last = 1e-3 * self.plant_map.step_ms, self.last
        for name in AT_REST:
            state.setdefault(name, 0.0)
        for rate, name in RATES.items():
            if rate not in state and name in state:
                state[rate] = (state[name] - last[name]) / step if last else 0.0
        if "vy" not in state:
            yaw = state["yaw"]
            dx, dy = (state[name] - last[name] if last else 0.0 for name in ("x", "y"))
            state["vy"] = (cos(yaw) * dy - sin(yaw) * dx) / step
        if "ax" not in state:
            change = (state["vx"] - last["vx"]) / step if last else 0.0
            state["ax"] = change - state["yaw_rate"] * state["vy"]
        for name, other in SAME.items():
            state.setdefault(name, state[other])
        loads = [state.get(f"wheel_load_{wheel}", nan) for wheel in WHEELS]
        if "two_wheel_lift" not in state and all(map(isfinite, loads)):
            state["two_wheel_lift"] = float(max(loads[0::2]) <= 0.0 or max(loads[1::2]) <= 0.0)
        state.setdefault("two_wheel_lift", nan)
        if "rollover" not in state:
            state["rollover"] = float(abs(state["roll"]) > ROLLOVER_ANGLE)


_DRIVES: dict[int, FmuDrive] = {}
_NUMBERS: Iterator[int] = count(1)


def _exchange(number: int, inputs: int, outputs: int, dt: float) -> None:
    """Step drive ``number``; its failure ends the run and is raised by :func:`check`."""
    drive, filled = _DRIVES[number], _vector(outputs, ports.N_OUTPUTS)
    try:
        if drive.failure is None:
            drive.step(_vector(inputs, ports.N_INPUTS), filled, dt)
    except BaseException as error:
        drive.failure = error
    if drive.failure is not None:
        filled[ports.ROLLOVER] = 1.0


def _vector(address: int, size: int) -> Vector:
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))


_EXCHANGE = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, ctypes.c_double)(
    _exchange
)
_ADDRESS = ctypes.cast(_EXCHANGE, ctypes.c_void_p).value
_exchange_at = function_at(
    numba.types.void(numba.types.int64, numba.types.int64, numba.types.int64, numba.types.float64)
)


@cfunc(STEP_SIGNATURE)
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance the FMU that ``parameters`` (address, number) name by ``dt`` (s)."""
    _exchange_at(int(parameters[0]))(
        int(parameters[1]), np.int64(inputs.ctypes.data), np.int64(outputs.ctypes.data), dt
    )


def check(parameters: Vector) -> None:
    """Raise what ended the drive of a body built with ``parameters``, and end its process."""
    drive = _DRIVES.get(int(parameters[1]))
    if drive is not None and drive.failure is not None:
        close(parameters)
        raise drive.failure


def close(parameters: Vector) -> None:
    """End the process of a body built with ``parameters``."""
    drive = _DRIVES.pop(int(parameters[1]), None)
    if drive is not None:
        drive.session.close()


def lacking(plant_map: PlantMap) -> tuple[str, ...]:
    """Return the outputs that the map does not have, those by wheel by their common name."""
    mapped = {wire.quantity for wire in plant_map.outputs}
    wheels = [n for n in BY_WHEEL if not mapped.issuperset(f"{n}_{wheel}" for wheel in WHEELS)]
    return (*(name for name in AT_REST if name not in mapped), *wheels)


def read(name: str) -> Body:
    """Return the body of an FMU; ``name`` is its path, with the map's after a "#".

    Without one the map is the file of the FMU's name that ends in .toml.

    Raises:
        CanrollError: an invalid FMU or map, or they do not fit each other.
    """
    model, _, other = name.partition("#")
    path = Path(model)
    if not path.is_file():
        raise CanrollError(f"{path}: no such file")
    plant_map = map_file.read(Path(other) if other else path.with_suffix(".toml"))
    fmu = description.read(path, plant_map)

    def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
        number = next(_NUMBERS)
        geometry = vehicle.geometry
        _DRIVES[number] = FmuDrive(
            name=path.name,
            plant_map=plant_map,
            session=FmuSession(path, fmu, plant_map, speed),
            speed=speed,
            steering_ratio=vehicle.steering.ratio,
            half_tracks=(geometry.half_track_front, geometry.half_track_rear),
        )
        return np.zeros(0), np.array([_ADDRESS, number], dtype=np.float64)

    return Body(
        path.name,
        step,
        build,
        outside=Outside(check, close),
        lacks=lacking(plant_map),
        constant_speed="drive_force" not in {wire.quantity for wire in plant_map.inputs},
    )
