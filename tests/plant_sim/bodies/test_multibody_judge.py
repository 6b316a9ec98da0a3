"""The 14-DOF car against an independent multibody solver of the same tree: MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

from canroll import vehicles
from canroll.plant_sim.bodies import nonlinear_car, ports
from canroll.plant_sim.nodes.imu_motion import FORCE, N_MOTION, RATE, specific_motion
from canroll.plant_sim.world import open_loop

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed: pip install mujoco")

from support.multibody import Car, State, vertical  # noqa: E402 - needs mujoco

NAMES = vehicles.names()


def coasting(name):
    """The vehicle without rolling resistance: rolling straight it is at rest otherwise."""
    vehicle = vehicles.load(name)
    return replace(vehicle, tyre=replace(vehicle.tyre, rolling_resistance=0.0))


def rolling(vehicle, speed):
    return State(velocity=np.array([speed, 0.0]), spin=np.full(4, speed / vehicle.tyre.radius))


def accelerations(motion):
    """All degrees of freedom of the mechanics in one vector."""
    return np.hstack(
        [
            motion.velocity,
            motion.yaw_rate,
            motion.heave_rate,
            motion.roll_rate,
            motion.pitch_rate,
            motion.travel_rate,
            motion.spin,
        ]
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_model_has_the_masses_of_the_vehicle(name):
    vehicle = vehicles.load(name)
    car = Car(vehicle)
    model, data = car.model, car.data
    car.place(State(), ports.initial_inputs())
    assert mujoco.mj_getTotalmass(model) == pytest.approx(vehicle.total_mass, rel=1e-12)
    centre = data.subtree_com[0]
    foot = [-vehicle.sprung_cg_offset, 0.0, vehicle.cg_height]
    np.testing.assert_allclose(centre, foot, atol=1e-12)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    yaw, pitch, roll = 3, 4, 5
    shifted = vehicle.mass.yaw_inertia + vehicle.total_mass * centre[0] ** 2
    assert inertia[yaw, yaw] == pytest.approx(shifted, rel=1e-9)
    unsprung = vehicle.mass.unsprung_front, vehicle.mass.unsprung_rear
    hubs = vehicle.tyre.radius - vehicle.roll_axis_height
    across = vehicle.plant.roll_inertia
    across += sum(m * (t**2 + hubs**2) for m, t in zip(unsprung, car.half_tracks, strict=True))
    assert inertia[roll, roll] == pytest.approx(across, rel=1e-9)
    arms = model.body_pos[car.axles, 0]
    over = vehicle.mass.pitch_inertia
    over += vehicle.plant.sprung_mass * vehicle.plant.cg_height_above_roll_axis**2
    over += sum(m * (x**2 + hubs**2) for m, x in zip(unsprung, arms, strict=True))
    over += 4 * vehicle.tyre.wheel_inertia
    assert inertia[pitch, pitch] == pytest.approx(over, rel=1e-9)
    for slide, hinge, mass, half in zip(
        car.slides, car.hinges, unsprung, car.half_tracks, strict=True
    ):
        assert inertia[slide, slide] == pytest.approx(mass, rel=1e-9)
        assert inertia[hinge, hinge] >= mass * half**2
    np.testing.assert_allclose(np.diag(inertia)[car.spins], vehicle.tyre.wheel_inertia, rtol=1e-9)


@pytest.mark.parametrize("speed", [0.0, 30.0])
@pytest.mark.parametrize("name", NAMES)
def test_a_car_that_stands_or_rolls_straight_does_not_accelerate(name, speed):
    vehicle = coasting(name)
    motion = Car(vehicle).motion(rolling(vehicle, speed), ports.initial_inputs())
    np.testing.assert_allclose(accelerations(motion), 0.0, atol=1e-9)
    assert motion.load.sum() == pytest.approx(vehicle.total_mass * vehicles.GRAVITY, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_on_a_bank_the_balanced_loads_are_the_weight_along_the_normal(name):
    vehicle = coasting(name)
    car, inputs, speed = Car(vehicle), ports.initial_inputs(), 20.0
    inputs[ports.BANK] = 0.12

    def resting(unknown):
        heave, roll, pitch, *travel, front, rear = unknown
        state = rolling(vehicle, speed)
        state.heave, state.roll, state.pitch = heave, roll, pitch
        state.travel = np.array(travel)
        # held by the side force of the tyres
        state.slip = np.array([front, front, rear, rear])
        return state

    def unbalanced(unknown):
        motion = car.motion(resting(unknown), inputs)
        return [
            motion.velocity[1],
            motion.yaw_rate,
            motion.heave_rate,
            motion.roll_rate,
            motion.pitch_rate,
            *motion.travel_rate,
        ]

    balance, _, solved, message = fsolve(unbalanced, np.zeros(9), xtol=1e-13, full_output=True)
    assert solved == 1, message
    np.testing.assert_allclose(unbalanced(balance), 0.0, atol=1e-8)
    motion = car.motion(resting(balance), inputs)
    weight = vehicle.total_mass * vehicles.GRAVITY
    assert motion.load.sum() == pytest.approx(weight * np.cos(0.12), rel=1e-9)
    assert motion.lateral.sum() == pytest.approx(weight * np.sin(0.12), rel=1e-9)
    # the left side is the higher one: the right wheels carry more, and the body leans to them
    assert motion.load[1] > motion.load[0] and motion.load[3] > motion.load[2]
    assert balance[1] > 0


def wild(rng, car):
    """A random state and random inputs, far beyond ordinary driving, on the road."""
    vehicle, inputs = car.vehicle, ports.initial_inputs()
    near = rng.choice([0.05, 1.0])  # upright on mostly four wheels, or on fewer
    inputs[ports.STEER] = rng.uniform(-0.4, 0.4)
    inputs[ports.DRIVE_FORCE] = rng.uniform(-5e3, 5e3)
    inputs[ports.BRAKE_FORCE : ports.BRAKE_FORCE + 4] = rng.uniform(0, 3e3, 4)
    inputs[ports.CORNER_FORCE : ports.CORNER_FORCE + 4] = rng.uniform(-3e3, 3e3, 4)
    inputs[ports.BAR_MOMENT_FRONT : ports.BAR_MOMENT_REAR + 1] = rng.uniform(-2e3, 2e3, 2)
    inputs[ports.ROAD_HEIGHT : ports.ROAD_HEIGHT + 4] = rng.uniform(-0.03, 0.03, 4)
    inputs[ports.BANK] = rng.uniform(-0.3, 0.3)
    inputs[ports.GRADE] = rng.uniform(-0.15, 0.15)
    inputs[ports.FRICTION] = rng.uniform(0.2, 1.2)
    inputs[ports.WHEEL_FRICTION : ports.WHEEL_FRICTION + 4] = rng.uniform(-0.15, 0.15, 4)
    inputs[ports.WIND_FORCE : ports.WIND_YAW + 1] = rng.uniform(-5e3, 5e3, 3)
    speed = rng.choice([rng.uniform(-5.0, 5.0), rng.uniform(5.0, 40.0)], p=[0.2, 0.8])
    state = State(
        velocity=np.array([speed, rng.uniform(-0.3, 0.3) * speed]),
        yaw_rate=rng.uniform(-1.0, 1.0),
        roll=near * rng.uniform(-0.5, 0.5),
        pitch=near * rng.uniform(-0.1, 0.1),
        heave_rate=rng.uniform(-0.5, 0.5),
        roll_rate=rng.uniform(-1.0, 1.0),
        pitch_rate=rng.uniform(-0.5, 0.5),
        travel=rng.choice([0.02, 0.02, 0.06, 0.12]) * rng.uniform(-1.0, 1.0, 4),
        travel_rate=rng.uniform(-1.0, 1.0, 4),
        spin=speed / vehicle.tyre.radius * rng.uniform(0.7, 1.2, 4),
        slip=rng.uniform(-0.3, 0.3, 4),
    )
    # the lowest wheel carries something between nothing and several times its static load
    car.place(state, inputs)
    heights = car.data.xpos[car.wheels][:, 2] - inputs[ports.ROAD_HEIGHT : ports.ROAD_HEIGHT + 4]
    upright = np.sqrt(1 - car.data.xmat[car.wheels][:, 7] ** 2)
    free = np.repeat([tyre.free_radius for tyre in car.tyres], 2) - rng.uniform(0.0, 0.1)
    state.heave = float(np.max(free * upright - heights))
    return state, inputs


def test_a_wheel_spins_by_the_torques_on_its_own_axis():
    car, rng = Car(vehicles.load("van_real")), np.random.default_rng(3)
    tyre = car.vehicle.tyre
    for _ in range(20):
        state, inputs = wild(rng, car)
        state.spin[:] = np.abs(state.spin) + 1.0
        inputs[ports.FRICTION] = 0.0  # no force of the tyre along the road
        inputs[ports.WHEEL_FRICTION : ports.WHEEL_FRICTION + 4] = 0.0
        motion = car.motion(state, inputs)
        static = np.repeat([t.static for t in car.tyres], 2)
        drive = inputs[ports.DRIVE_FORCE] * static / (car.vehicle.total_mass * vehicles.GRAVITY)
        brake = inputs[ports.BRAKE_FORCE : ports.BRAKE_FORCE + 4]
        force = drive - brake - tyre.rolling_resistance * motion.load
        np.testing.assert_allclose(motion.spin, force * tyre.radius / tyre.wheel_inertia, rtol=1e-9)


def test_rates_along_the_turning_axes_are_those_of_the_moving_components():
    car, rng = Car(vehicles.load("car_2020")), np.random.default_rng(4)
    for _ in range(20):
        state, inputs = wild(rng, car)
        motion = car.motion(state, inputs)
        up, velocity, acceleration = vertical(inputs), car.data.qvel.copy(), car.data.qacc.copy()

        def components(time, up=up, velocity=velocity, acceleration=acceleration):
            """Velocity of P along R's axes after a while of these accelerations."""
            angle, back = time * velocity[3] + time**2 / 2 * acceleration[3], np.zeros(9)
            quaternion = np.hstack([np.cos(angle / 2), np.sin(angle / 2) * up])
            mujoco.mju_quat2Mat(back, quaternion)
            return back.reshape(3, 3).T @ (velocity[:3] + time * acceleration[:3])

        instant = 1e-5
        seen = (components(instant) - components(-instant)) / (2 * instant)
        np.testing.assert_allclose([*motion.velocity, motion.heave_rate], seen, atol=1e-5)


def test_the_free_model_keeps_energy_and_momenta():
    car, rng = Car(vehicles.load("suv_2020")), np.random.default_rng(5)
    car.place(*wild(rng, car))
    model, data = car.model, car.data
    model.opt.gravity[:] = 0.0
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 1e-4
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY

    def kept():
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        angular = data.subtree_angmom[car.sprung]
        return np.hstack([data.energy[1], data.subtree_linvel[car.sprung], angular])

    before = kept()
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert abs(data.qpos[5]) > 0.01
    np.testing.assert_allclose(kept(), before, rtol=1e-7, atol=1e-7 * np.abs(before).max())


def of_kernel(state, yaw):
    """The same state in the plant's layout, with a heading."""
    vector = np.zeros(nonlinear_car.N_STATES)
    vector[nonlinear_car.YAW] = yaw
    vector[nonlinear_car.VX], vector[nonlinear_car.VY] = state.velocity
    for name in ("yaw_rate", "heave", "roll", "pitch", "heave_rate", "roll_rate", "pitch_rate"):
        vector[getattr(nonlinear_car, name.upper())] = getattr(state, name)
    for name in ("travel", "travel_rate", "spin", "slip"):
        first = getattr(nonlinear_car, name.upper())
        vector[first : first + 4] = getattr(state, name)
    return vector


def compared(vehicle, motion, state, inputs, yaw):
    """What the plant and the judge say by name, with the size that counts as 1."""
    slots, ms2 = nonlinear_car, vehicles.GRAVITY
    vector, parameters = of_kernel(state, yaw), slots.build(vehicle, 0.0)[1]
    rate, results = np.zeros(slots.N_STATES), np.zeros(slots.N_RESULTS)
    slots.evaluate(vector, inputs, parameters, rate, results)
    outputs, imu = np.zeros(ports.N_OUTPUTS), np.zeros(N_MOTION)
    open_loop.advance(slots.BODY.step, vector, inputs, parameters, outputs, 0.0)
    specific_motion(inputs, outputs, np.array(vehicle.sensors.imu_position), imu)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    weight, behind = vehicle.total_mass * ms2, np.array([-vehicle.sprung_cg_offset, 0.0])
    carried = motion.foot + state.yaw_rate * np.array([0.0, behind[0]])

    def four(values, first):
        return values[first : first + 4]

    return {
        "position": (rate[[slots.X, slots.Y]], turn @ motion.foot, 1.0),
        "yaw": (rate[slots.YAW], state.yaw_rate, 1.0),
        "heave": (rate[slots.HEAVE], state.heave_rate, 1.0),
        "roll": (rate[slots.ROLL], state.roll_rate, 1.0),
        "pitch": (rate[slots.PITCH], state.pitch_rate, 1.0),
        "travel": (four(rate, slots.TRAVEL), state.travel_rate, 1.0),
        "velocity": (rate[[slots.VX, slots.VY]], motion.velocity, ms2),
        "yaw rate": (rate[slots.YAW_RATE], motion.yaw_rate, ms2),
        "heave rate": (rate[slots.HEAVE_RATE], motion.heave_rate, ms2),
        "roll rate": (rate[slots.ROLL_RATE], motion.roll_rate, ms2),
        "pitch rate": (rate[slots.PITCH_RATE], motion.pitch_rate, ms2),
        "travel rate": (four(rate, slots.TRAVEL_RATE), motion.travel_rate, ms2),
        "spin": (four(rate, slots.SPIN), motion.spin, ms2),
        "slip": (four(rate, slots.SLIP), motion.slip, 1.0),
        "load": (four(outputs, ports.WHEEL_LOAD), motion.load, weight),
        "lateral force": (four(outputs, ports.LATERAL_FORCE), motion.lateral, weight),
        "CG position": (outputs[[ports.X, ports.Y]], turn @ behind, 1.0),
        "CG velocity": (outputs[[ports.VX, ports.VY]], carried, 1.0),
        "CG acceleration": (outputs[[ports.AX, ports.AY]], motion.cg[:2], ms2),
        "sprung CG acceleration": (
            outputs[ports.BODY_ACC : ports.BODY_ACC + 3],
            motion.sprung_cg,
            ms2,
        ),
        "gyro": (imu[RATE : RATE + 3], motion.gyro, 1.0),
        "accelerometer": (imu[FORCE : FORCE + 3], motion.accelerometer, ms2),
    }


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("count", [100, pytest.param(1700, marks=pytest.mark.long)])
def test_the_plant_accelerates_like_the_judge_in_any_state(count, name):
    vehicle, rng = vehicles.load(name), np.random.default_rng([count, NAMES.index(name)])
    car, wheels, stopped = Car(vehicle), np.zeros(5, dtype=int), 0
    clearances = vehicle.suspension.rebound_clearance, vehicle.suspension.bump_clearance
    for case in range(count):
        state, inputs = wild(rng, car)
        motion = car.motion(state, inputs)
        wheels[np.count_nonzero(motion.load)] += 1
        stopped += state.travel.max() > clearances[0] or -state.travel.min() > clearances[1]
        quantities = compared(vehicle, motion, state, inputs, rng.uniform(-np.pi, np.pi))
        for what, (plant, judge, size) in quantities.items():
            off = np.abs(np.subtract(plant, judge)) / (np.abs(judge) + size)
            assert np.max(off) <= 1e-9, f"{what} in case {case}: {plant}, not {judge}"
    assert (wheels[1:] >= count / 20).all(), "too few cases on one, two, three or four wheels"
    assert count / 10 < stopped < count
