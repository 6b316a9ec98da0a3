"""Cars at the corners of the box, driven: their monitors accuse no sound axle.

The car is four states of roll on two tyres each of which bears what the axle passes on, with its
own numbers; the monitors are the firmware's with the design's numbers.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import StateSpace, lsim

from canroll.firmware import calibration as fw
from canroll.firmware.monitors.axles import watch_axles, watch_heave
from canroll.firmware.monitors.residual import HEAVE
from canroll.firmware.monitors.response import road_uncertainty
from canroll.firmware.state import RX_IMU, Ecu
from canroll.gain_gen.calibration.response_part import response_fields
from canroll.gain_gen.models.task import Delay, Task
from canroll.gain_gen.monitors.uncertainty import DEFAULT as BOX
from canroll.vehicles import GRAVITY, Vehicle, load
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

pytestmark = pytest.mark.slow

STEP, SPEED = 0.01, 22.0
TIMES = np.arange(0.0, 9.0, STEP)
MOST = 0.9
"""Of the lateral acceleration up to which the axles are judged."""


def slalom() -> np.ndarray:
    return np.sin(2.0 * np.pi * 0.4 * TIMES)


def bend_and_back() -> np.ndarray:
    """A long curve to one side and one to the other, each entered within a second."""
    return np.interp(TIMES, [1.0, 2.0, 5.0, 6.0], [0.0, 1.0, 1.0, -1.0])


@dataclass(frozen=True, slots=True)
class Corner:
    """Signs of what differs from the design; a moment's and a roll centre's is that at the front,
    the rear's is the other."""

    mass: int
    stiffness: int
    damping: int
    tyre: int
    roll_centre: int
    moment: int

    def of(self, name: str) -> float:
        return 1.0 + getattr(self, name) * float(getattr(BOX, name))


# dampers that are weak let the body swing most
CORNERS = [
    Corner(mass, stiffness, -1, *signs) for mass, stiffness, *signs in product((-1, 1), repeat=5)
]


def roll(vehicle: Vehicle, corner: Corner, lateral: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Roll rates of both suspensions and the unit's lateral acceleration; ``moments`` reported.

    They are wrong by as much as can be of what the front has more than the rear.
    """
    geometry, mass, plant = vehicle.geometry, vehicle.mass, vehicle.plant
    front = vehicle.suspension.roll_stiffness_front_share
    springs = corner.of("stiffness") * suspension_roll_stiffness(vehicle)
    springs = springs * np.array([front, 1.0 - front])
    front = vehicle.suspension.roll_damping_front_share
    dampers = corner.of("damping") * plant.roll_damping * np.array([front, 1.0 - front])
    halves = np.array([geometry.half_track_front, geometry.half_track_rear])
    tyres = corner.of("tyre") * 2.0 * vehicle.tyre.vertical_stiffness * halves**2
    axles = np.array([geometry.cg_to_rear_axle, geometry.cg_to_front_axle]) / geometry.wheelbase
    unsprung = np.array([mass.unsprung_front, mass.unsprung_rear])
    moved = corner.roll_centre * BOX.roll_centre * np.array([1.0, -1.0])
    heights = np.array([geometry.roll_centre_height_front, geometry.roll_centre_height_rear])
    on_road = corner.of("mass") * (vehicle.total_mass * axles - unsprung) * (heights + moved)
    on_road = on_road + unsprung * vehicle.tyre.radius
    yawing = (heights + moved) * [1.0, -1.0] * mass.yaw_inertia / geometry.wheelbase
    yawing = corner.of("mass") * yawing
    arm = corner.of("mass") * plant.roll_arm
    # tilt t of the axles: (T − g S) t + C (t' − φ') + K (t − φ) = S a + Y r' − M
    inverse = np.diag(1.0 / dampers)
    a, b = np.zeros((4, 4)), np.zeros((4, 4))
    a[0, 1] = 1.0
    a[2:, :2] = np.column_stack([springs / dampers, [1.0, 1.0]])
    a[2:, 2:] = -inverse @ np.diag(tyres - GRAVITY * on_road + springs)
    b[2:] = inverse @ np.column_stack([on_road, yawing, -np.eye(2)])
    # J φ'' = m h (a + g φ) + M − Σ K (φ − t) + C (φ' − t')
    inertia = corner.of("mass") * plant.roll_inertia
    a[1] = (dampers @ a[2:] + [arm * GRAVITY - springs.sum(), -dampers.sum(), *springs]) / inertia
    b[1] = (dampers @ b[2:] + [arm, 0.0, 1.0, 1.0]) / inertia
    turning = np.gradient(lateral / SPEED, STEP)
    side = np.sign((moments[:, 0] * moments[:, 1]).sum())
    factors = 1.0 + corner.moment * BOX.moment * np.array([1.0, -side])
    inputs = np.column_stack([lateral, turning, moments * factors])
    states = lsim(StateSpace(a, b, np.eye(4), np.zeros((4, 4))), inputs, TIMES)[1]
    rates = states @ a.T + inputs @ b.T
    return np.column_stack([rates[:, :1] - rates[:, 2:], lateral + GRAVITY * states[:, 0]])


def watched(vehicle: Vehicle) -> tuple[fw.Calibration, Ecu]:
    """The monitors of a design, on, and what acts is known."""
    task = Task(vehicle, Delay.constant(0.02), tick=STEP, actuator="suspension")
    cal = rig.calibration(actuator=fw.SUSPENSION)
    for name, value in response_fields(task, BOX).items():
        setattr(cal, name, value)
    ecu = rig.started(cal)
    ecu.motion_lost, ecu.response_known = 0, 1
    ecu.valid[RX_IMU] = 7
    return cal, ecu


@pytest.mark.parametrize(
    ("name", "manoeuvre", "shares"),
    [
        ("van_real", bend_and_back, [0.6, 0.4]),
        ("van_real", bend_and_back, [0.8, -0.8]),
        ("van_2021", slalom, [0.6, 0.4]),
        ("sedan_320i", bend_and_back, [0.6, 0.4]),
    ],
)
def test_no_axle_of_a_car_of_the_box_is_accused(name, manoeuvre, shares):
    vehicle = load(name)
    halves = np.array([vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear])
    tracks = np.repeat(halves, 2) * [1.0, -1.0, 1.0, -1.0]
    accused = []
    for corner in CORNERS:
        cal, ecu = watched(vehicle)
        lateral = MOST * cal.axles_limit / 2**fw.Q_ACCELERATION * manoeuvre()
        moments = np.outer(-0.5 * vehicle.plant.roll_arm * lateral, shares)
        samples = roll(vehicle, corner, lateral, moments)
        for *rates, measured, moment, yaw in zip(*samples.T, moments, lateral / SPEED, strict=True):
            strokes = np.repeat(rates, 2) * tracks
            ecu.stroke_rate = [round(stroke * 2**fw.Q_RATE) for stroke in strokes]
            ecu.delivered = [round(value * 2**fw.Q_MOMENT) for value in moment]
            ecu.lateral_acceleration = round(measured * 2**fw.Q_ACCELERATION)
            ecu.yaw_rate = round(yaw * 2**fw.Q_RATE)
            watch_axles(ecu, cal)
        if ecu.contradicted != 0:
            accused.append(corner)
    assert accused == []


def test_a_hill_lifts_no_corner_of_softer_springs():
    """The sprung mass at its heaviest, over the largest hill, on springs at their softest."""
    vehicle = load("van_real")
    cal, ecu = watched(vehicle)
    suspension = vehicle.suspension
    soft = np.array([suspension.spring_rate_front, suspension.spring_rate_rear])
    soft = soft * (1.0 - BOX.stiffness)
    weight = BOX.hill * (1.0 + BOX.mass) * vehicle.design.sprung_mass
    travel = np.interp(TIMES, [1.0, 1.5], [0.0, 1.0]) * weight / (2.0 * soft.sum())
    for rate in np.gradient(travel, STEP):
        ecu.stroke_rate = [round(rate * 2**fw.Q_RATE)] * 4
        watch_heave(ecu, cal)
    assert rig.accused_axles(ecu) == [0, 0]
    assert ecu.evidence[HEAVE] == 0


@given(
    rates=st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4),
    name=st.sampled_from(["van_real", "car_2020"]),
)
def test_what_is_allowed_on_a_rough_road_covers_rebound_and_the_dampers_knee(rates, name):
    vehicle = load(name)
    cal, ecu = watched(vehicle)
    suspension = vehicle.suspension
    mean = 0.5 * (1.0 + suspension.rebound_bump_ratio)
    slopes = np.where(np.array(rates) > 0.0, suspension.rebound_bump_ratio, 1.0) / mean
    slow = np.clip(rates, -suspension.knee_speed, suspension.knee_speed)
    # forces over those of linear dampers, front left, front right, rear left, rear right
    forces = slopes * (slow + suspension.high_speed_ratio * (rates - slow)) - rates
    by_axle = np.array(cal.response_stroke) / 2**10
    moment = by_axle @ [forces[0] - forces[1], forces[2] - forces[3]]
    ecu.stroke_rate = [round(rate * 2**fw.Q_RATE) for rate in rates]
    assert abs(moment) <= road_uncertainty(ecu, cal) / 2**fw.Q_MOMENT + 1.0
