import numpy as np
import pytest
from scipy.linalg import expm

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world import open_loop

BODY = bodies.body("roll1")


def settle(vehicle, speed=15.0, seconds=12.0, **slots):
    state, parameters = BODY.build(vehicle, speed)
    inputs = ports.initial_inputs()
    for name, value in slots.items():
        inputs[getattr(ports, name)] = value
    outputs = np.zeros(ports.N_OUTPUTS)
    for _ in range(int(seconds / 1e-3)):
        open_loop.advance(BODY.step, state, inputs, parameters, outputs, 1e-3)
    return outputs


def test_roll_step_equals_the_matrix_exponential():
    vehicle = vehicles.load("van_real")
    roll = vehicle.plant
    a = np.array(
        [
            [0.0, 1.0, 0.0],
            [
                -roll.effective_stiffness / roll.roll_inertia,
                -roll.roll_damping / roll.roll_inertia,
                (roll.roll_arm * 3.0 + 500.0) / roll.roll_inertia,
            ],
            [0.0, 0.0, 0.0],
        ]
    )
    expected = expm(a * 0.4) @ [0.0, 0.0, 1.0]
    outputs = settle(vehicle, seconds=0.4, LATERAL_ACCELERATION=3.0, BAR_MOMENT_REAR=500.0)
    assert outputs[ports.ROLL] == pytest.approx(expected[0], rel=1e-9)
    assert outputs[ports.ROLL_RATE] == pytest.approx(expected[1], rel=1e-7)


def test_actuators_and_bank_have_the_sign_of_their_axis_page():
    vehicle = vehicles.load("van_real")
    assert settle(vehicle, CORNER_FORCE=1000.0)[ports.ROLL] > 0
    assert settle(vehicle, BAR_MOMENT_FRONT=1000.0)[ports.ROLL] > 0
    assert settle(vehicle, LATERAL_ACCELERATION=0.0, BANK=0.05)[ports.ROLL] > 0


@pytest.mark.parametrize("name", vehicles.names())
def test_steady_roll_and_understeer_equal_their_closed_forms(name):
    vehicle = vehicles.load(name)
    steer, speed = 0.01, 15.0
    outputs = settle(vehicle, speed=speed, STEER=steer)
    gradient = np.radians(vehicle.plant.roll_gradient_deg_per_g) / vehicles.GRAVITY
    assert outputs[ports.ROLL] / outputs[ports.AY] == pytest.approx(gradient, rel=1e-6)
    geometry = vehicle.geometry
    curvature = outputs[ports.YAW_RATE] / speed
    understeer = vehicle.understeer
    assert steer == pytest.approx(
        geometry.wheelbase * curvature + understeer * outputs[ports.AY], rel=1e-6
    )


def test_wheel_loads_carry_the_weight_and_balance_the_overturning_moment():
    vehicle = vehicles.load("van_real")
    still = settle(vehicle, seconds=0.01)
    loads = still[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
    assert loads.sum() == pytest.approx(vehicle.total_mass * vehicles.GRAVITY, rel=1e-12)

    turning = settle(vehicle, LATERAL_ACCELERATION=3.0)
    loads = turning[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
    front, rear = vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear
    moment = front * (loads[1] - loads[0]) + rear * (loads[3] - loads[2])
    overturning = vehicle.total_mass * vehicle.cg_height * 3.0
    overturning += vehicle.plant.roll_arm * vehicles.GRAVITY * turning[ports.ROLL]
    # Roll centres are weighed by axle load, the CG's roll-axis height by the sprung mass alone.
    assert moment == pytest.approx(overturning, rel=2e-3)


def test_moment_of_actuators_moves_load_between_axles_not_off_the_car():
    """Total load transfer is set by moment balance: less roll takes off only m g h φ."""
    vehicle = vehicles.load("van_real")
    free = settle(vehicle, LATERAL_ACCELERATION=3.0)
    held = settle(vehicle, LATERAL_ACCELERATION=3.0, BAR_MOMENT_FRONT=-3000.0)
    tracks = vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear

    def moment(outputs):
        loads = outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
        return tracks[0] * (loads[1] - loads[0]) + tracks[1] * (loads[3] - loads[2])

    change = vehicle.plant.roll_arm * vehicles.GRAVITY * (free[ports.ROLL] - held[ports.ROLL])
    assert held[ports.ROLL] < free[ports.ROLL]
    assert moment(free) - moment(held) == pytest.approx(change, rel=1e-9)


def test_mirrored_steering_gives_the_mirrored_run():
    vehicle = vehicles.load("suv_2020")
    left, right = settle(vehicle, STEER=0.02), settle(vehicle, STEER=-0.02)
    for slot in (ports.Y, ports.ROLL, ports.AY, ports.YAW_RATE):
        assert left[slot] == -right[slot]
    assert left[ports.WHEEL_LOAD] == right[ports.WHEEL_LOAD + 1]


@pytest.mark.parametrize(
    ("maneuver", "printed", "mean"),
    [
        ("roundabout", {"rms": 3.14, "max": 4.91, "nlt": (0.36, 0.34)}, 0.05),
        # the course is calibrated on the largest roll alone: the mean is a check
        ("double_lane_change", {"rms": 2.36, "max": 3.48, "nlt": (0.29, 0.27)}, 0.25),
    ],
)
def test_calibrated_van_meets_the_printed_passive_rows(maneuver, printed, mean):
    """Redondo 2021, tables 2 to 5: largest roll within 5.5 %, load transfer within 10 %."""
    vehicle = vehicles.load("van_2021")
    outputs, _ = open_loop.run_passive(vehicle, BODY, maneuvers.build(maneuver, vehicle))
    roll = np.degrees(outputs[:, ports.ROLL])
    assert np.sqrt(np.mean(roll**2)) == pytest.approx(printed["rms"], rel=mean)
    assert np.abs(roll).max() == pytest.approx(printed["max"], rel=0.055)
    for axle in (0, 1):
        transfer = np.abs(open_loop.load_transfer(outputs, axle)).max()
        assert transfer == pytest.approx(printed["nlt"][axle], rel=0.10)
