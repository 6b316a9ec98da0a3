"""The numeric linearisation: equal to closed forms, and to what small steps of the body do."""

from dataclasses import replace
from functools import cache

import control
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.linear_car import N_DRIVE, N_LINEAR
from canroll.plant_sim.kernels.jit import STEP_SIGNATURE, cfunc
from canroll.plant_sim.world import linearise
from canroll.plant_sim.world.linearise import IMU_LATERAL_ACCELERATION
from canroll.plant_sim.world.modes import modes
from canroll.plant_sim.world.open_loop import advance
from canroll.vehicles.model import GRAVITY

VAN = vehicles.load("van_real")
STEP = linearise.STEP
SHOWN = (ports.ROLL_RATE, ports.ROLL, ports.AY, ports.YAW_RATE)


@cache
def trimmed(name, speed=80 / 3.6, lateral_acceleration=0.0, friction=1.0):
    return linearise.find_trim(
        VAN,
        bodies.body(name),
        speed=speed,
        lateral_acceleration=lateral_acceleration,
        friction=friction,
    )


def unit(slot, size=1.0):
    inputs = np.zeros(ports.N_INPUTS)
    inputs[slot] = size
    return inputs


MOMENT = unit(ports.BAR_MOMENT_FRONT, 0.5) + unit(ports.BAR_MOMENT_REAR, 0.5)


def poles(matrix):
    return np.linalg.eigvals(matrix)


def paired(found, expected):
    """Return ``found`` in the order of ``expected``; rounding decides on any other."""
    return found[linear_sum_assignment(np.abs(expected[:, None] - found))[1]]


def test_roll1_is_its_equations():
    plant = linearise.linearise(trimmed("roll1"))
    roll, speed = VAN.plant, 80 / 3.6
    front, rear = VAN.geometry.cg_to_front_axle, VAN.geometry.cg_to_rear_axle
    f, r = VAN.tyre.cornering_stiffness_front, VAN.tyre.cornering_stiffness_rear
    bicycle = np.array(
        [
            [-(f + r) / (VAN.total_mass * speed), 0.0],
            [0.0, -(front**2 * f + rear**2 * r) / (VAN.mass.yaw_inertia * speed)],
        ]
    )
    bicycle[0, 1] = (rear * r - front * f) / (VAN.total_mass * speed) - speed
    bicycle[1, 0] = (rear * r - front * f) / (VAN.mass.yaw_inertia * speed)
    stiffness = -roll.effective_stiffness / roll.roll_inertia
    body = np.array([[0.0, 1.0], [stiffness, -roll.roll_damping / roll.roll_inertia]])
    expected = np.concatenate([np.linalg.eigvals(bicycle), np.linalg.eigvals(body)])
    assert paired(poles(plant.a), expected) == pytest.approx(expected, rel=1e-6)
    static = plant.response(np.array([1e-4]), MOMENT, [ports.ROLL])
    assert static.real == pytest.approx(1.0 / roll.effective_stiffness, rel=1e-6)


@pytest.mark.parametrize("name", ["linear_car", "linear_car_hydraulic"])
def test_linear_car_is_its_matrices(name):
    """All of its poles but those of bars that it has not, which rest."""
    speed = 80 / 3.6
    _, parameters = bodies.body(name).build(VAN, speed)
    inside = parameters[parameters.size - N_LINEAR * (N_LINEAR + N_DRIVE) :]
    matrix = inside[: N_LINEAR * N_LINEAR].reshape(N_LINEAR, N_LINEAR)
    used = matrix.any(axis=0) | matrix.any(axis=1)
    expected = poles(matrix[np.ix_(used, used)])
    found = poles(linearise.linearise(trimmed(name)).a)
    expected, found = expected[np.abs(expected) > 1e-6], found[np.abs(found) > 1e-6]
    found = paired(found, expected)
    # What is linearised is the plant's step, whose fourth order is 2 % off at 1200 rad/s.
    assert found == pytest.approx(expected, rel=0.03)
    slow = np.abs(expected) < 300.0
    assert found[slow] == pytest.approx(expected[slow], rel=1e-4)


@pytest.mark.parametrize("name", ["nonlinear", "linear_car", "roll1"])
@pytest.mark.parametrize(("lateral", "friction"), [(0.0, 1.0), (4.0, 1.0), (3.2, 0.5)])
def test_a_trim_stays_as_it_is(name, lateral, friction):
    trim = trimmed(name, lateral_acceleration=lateral, friction=friction)
    assert trim.outputs[ports.AY] == pytest.approx(lateral, abs=1e-6)
    assert trim.outputs[ports.VX] == pytest.approx(80 / 3.6, rel=1e-6)
    # felt on a body that leans outwards
    felt = trim.outputs[IMU_LATERAL_ACCELERATION]
    leaning = lateral + GRAVITY * np.sin(trim.outputs[ports.ROLL])
    assert felt == pytest.approx(leaning, abs=0.02 * lateral + 1e-9)
    state, outputs = trim.state.copy(), np.zeros(ports.N_OUTPUTS)
    for _ in range(1000):
        advance(trim.body.step, state, trim.inputs, trim.parameters, outputs, STEP)
    held = slice(ports.VX, ports.PATH_ERROR)
    assert outputs[held] == pytest.approx(trim.outputs[held], rel=1e-6, abs=1e-6)


EXCITED = [
    pytest.param(unit(ports.STEER, 2e-4), 0.0, 1.0, id="steer"),
    pytest.param(unit(ports.STEER, 2e-4), 4.0, 1.0, id="steer in a curve"),
    pytest.param(unit(ports.STEER, 1e-4), 3.2, 0.5, id="steer on a slippery curve"),
    pytest.param(50.0 * MOMENT, 0.0, 1.0, id="moment"),
    pytest.param(50.0 * MOMENT, 4.0, 1.0, id="moment in a curve"),
]


def driven(trim, excitation, signal):
    """Outputs SHOWN about the trim, step by step, of the body itself."""
    state, outputs = trim.state.copy(), np.zeros(ports.N_OUTPUTS)
    found = np.empty((len(SHOWN), signal.size))
    for k, value in enumerate(signal):
        inputs = trim.inputs + value * excitation
        advance(trim.body.step, state, inputs, trim.parameters, outputs, STEP)
        found[:, k] = outputs[list(SHOWN)] - trim.outputs[list(SHOWN)]
    return found


def chirp(duration, low, high):
    """A sine whose frequency rises from ``low`` to ``high`` (Hz), faded in and out."""
    time = np.arange(round(duration / STEP)) * STEP
    rate = np.log(high / low) / duration
    phase = 2 * np.pi * low * (np.exp(rate * time) - 1.0) / rate
    fade = np.clip(np.minimum(time, duration - time) / 0.5, 0.0, 1.0)
    return np.sin(phase) * fade


@pytest.mark.parametrize(("excitation", "lateral", "friction"), EXCITED)
def test_chirp_of_the_nonlinear_car_is_that_of_the_linear_one(excitation, lateral, friction):
    """0.2 to 12 Hz by python-control, with dampers that are as stiff in bump as in rebound."""
    even = replace(VAN, suspension=replace(VAN.suspension, rebound_bump_ratio=1.0))
    trim = linearise.find_trim(
        even,
        bodies.body("nonlinear"),
        speed=80 / 3.6,
        lateral_acceleration=lateral,
        friction=friction,
    )
    plant = linearise.linearise(trim)
    rows, signal = list(SHOWN), chirp(15.0, 0.2, 12.0)
    d = plant.d[rows] @ excitation[:, None]
    system = control.ss(plant.a, plant.b @ excitation[:, None], plant.c[rows], d)
    sampled = control.sample_system(system, STEP)
    found = control.forced_response(sampled, inputs=np.append(signal, 0.0)).outputs
    # A step's outputs are those at its end under the input that it held.
    expected = np.asarray(found)[:, 1:] + d * (signal - np.append(signal[1:], 0.0))
    error = np.abs(driven(trim, excitation, signal) - expected).max(axis=1)
    assert (error < (2e-3 if lateral else 1e-5) * np.abs(expected).max(axis=1)).all()


@pytest.mark.parametrize(("excitation", "lateral", "friction"), EXCITED)
def test_sines_of_the_nonlinear_car_have_the_linear_first_harmonic(excitation, lateral, friction):
    """With the van's own dampers, 1.8 times as stiff in rebound."""
    trim = trimmed("nonlinear", lateral_acceleration=lateral, friction=friction)
    plant = linearise.linearise(trim)
    for frequency in (0.5, 1.0, 2.0, 4.0):
        period = round(1 / (frequency * STEP))
        phase = 2 * np.pi * np.arange(4000 + 2 * period) / period
        outputs = driven(trim, excitation, np.sin(phase))[:, 4000:]
        window = np.exp(-1j * phase[4000:])
        # half a step: from the middle of a held input to the end of its step
        harmonic = outputs @ window * np.exp(-1j * np.pi / period) / (np.sin(phase[4000:]) @ window)
        linear = plant.response(np.array([frequency]), excitation, SHOWN)[:, 0]
        assert (np.abs(harmonic - linear) < 0.012 * np.abs(linear)).all()


def test_modes_are_named_by_what_moves():
    found = modes(linearise.linearise(trimmed("nonlinear")))
    by_name = {}
    for mode in found:
        by_name.setdefault(mode.motion, []).append(mode)
    tyre, mass, suspension = VAN.tyre, VAN.mass, VAN.suspension
    hop = np.sqrt(
        2 * (tyre.vertical_stiffness + suspension.spring_rate_rear) / mass.unsprung_rear
    ) / (2 * np.pi)
    assert by_name["rear axle hop"][0].frequency == pytest.approx(hop, rel=0.1)
    # nearly the same frequency, so that heave and pitch mix
    for name in ("heave", "pitch"):
        assert 1.2 < by_name[name][0].frequency < 1.45
    assert len(by_name["wheel spin"]) == len(by_name["tyre slip"]) == 4
    assert {"roll", "pitch", "front axle hop", "front axle tramp", "rear axle tramp"} <= set(
        by_name
    )
    for mode in by_name["tyre slip"][-2:]:
        assert mode.pole == pytest.approx(-80 / 3.6 / tyre.relaxation_length, rel=1e-3)
    # the same in a curve, where everything couples
    curve = {m.motion for m in modes(linearise.linearise(trimmed("nonlinear", 80 / 3.6, 4.0)))}
    assert {"heave", "pitch", "roll", "sideslip", "speed"} <= curve
    bars = [m.motion for m in modes(linearise.linearise(trimmed("linear_car_hydraulic")))]
    assert bars.count("bar") == 4


@pytest.mark.parametrize(
    ("body", "speed_kmh", "lateral_acceleration"),
    [("nonlinear", 80, 12), ("linear_car", 80, 12), ("nonlinear", 100, 9)],
)
def test_too_fast_a_curve_is_refused(body, speed_kmh, lateral_acceleration):
    refusal = f"no steady curve of {lateral_acceleration} m/s² on four wheels"
    with pytest.raises(CanrollError, match=refusal):
        linearise.find_trim(
            VAN,
            bodies.body(body),
            speed=speed_kmh / 3.6,
            lateral_acceleration=float(lateral_acceleration),
        )


@cfunc(STEP_SIGNATURE)
def _repeat(state, inputs, parameters, outputs, dt):
    outputs[ports.ROLL] = state[0]
    if dt > 0.0:
        state[0] = inputs[ports.STEER]


def test_a_body_that_does_not_integrate_is_refused():
    repeat = ports.Body("repeat", _repeat, lambda vehicle, speed: (np.zeros(1), np.zeros(1)))
    trim = linearise.Trim(
        vehicle=VAN,
        body=repeat,
        state=np.zeros(1),
        inputs=ports.initial_inputs(),
        parameters=np.zeros(1),
        relevant=np.array([0]),
        outputs=np.zeros(ports.N_OUTPUTS + 1),
    )
    with pytest.raises(CanrollError, match="body repeat overwrites a state in each step"):
        linearise.linearise(trim)
