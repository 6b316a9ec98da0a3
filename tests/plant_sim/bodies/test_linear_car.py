"""The full car against python-control, on equations written down anew from the paper."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.car_bodies import axles_of

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import linear_car, ports
from canroll.plant_sim.world import open_loop
from canroll.vehicles.axles import axles
from canroll.vehicles.full_car import (
    AS_PRINTED,
    INPUTS,
    REPAIRED,
    STATES,
    from_vehicle,
    state_matrices,
)
from canroll.vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness

SPEED = 70 / 3.6


def descriptor(car, speed):
    """E, A, B of Vu 2020, equations 1 to 12, one scalar equation at a time, paper's wheel order."""
    g, valves = 9.81, car.valves
    names = [
        *("zs", "th", "ph", "z1", "z2", "z3", "z4", "dzs", "dth", "dph", "dz1", "dz2", "dz3"),
        *("dz4", "be", "r", "xf", "dxf", "pf", "tf", "dtf", "xr", "dxr", "pr", "tr", "dtr"),
    ]
    at = {name: i for i, name in enumerate(names)}
    e, a, b = np.zeros((26, 26)), np.zeros((26, 26)), np.zeros((26, 7))  # d, q1..q4, uf, ur
    for name in names[:7]:
        e[at[name], at[name]] = 1
        a[at[name], at["d" + name]] = 1
    c = car.half_track[0]
    corners = {  # wheel: (x, y, axle), 1 FL, 2 RL, 3 RR, 4 FR
        1: (car.distance[0], c, 0),
        2: (car.distance[1], c, 1),
        3: (car.distance[1], -c, 1),
        4: (car.distance[0], -c, 0),
    }
    m, h = car.sprung_mass, car.roll_height
    e[at["dzs"], at["dzs"]] = m
    e[at["dth"], at["dth"]] = car.pitch_inertia + m * car.pitch_height**2
    a[at["dth"], at["th"]] = m * g * car.pitch_height
    e[at["dph"], at["dph"]] = car.roll_inertia + m * h**2
    e[at["dph"], at["be"]] = -m * h * speed
    a[at["dph"], at["r"]] = m * h * speed
    a[at["dph"], at["ph"]] = m * g * h
    for w, (x, y, axle) in corners.items():
        e[at[f"dz{w}"], at[f"dz{w}"]] = car.unsprung[axle]
        a[at[f"dz{w}"], at[f"z{w}"]] -= car.tyre_stiffness
        b[at[f"dz{w}"], w] = car.tyre_stiffness
        for rate, factor in (("", -car.spring[axle]), ("d", -car.damping[axle])):
            for part, gain in (("zs", 1), ("th", -x), ("ph", y), (f"z{w}", -1)):
                force = factor * gain
                a[at["dzs"], at[rate + part]] += force
                a[at["dth"], at[rate + part]] -= x * force
                a[at["dph"], at[rate + part]] += y * force
                a[at[f"dz{w}"], at[rate + part]] -= force
    for left, right, tag, u in ((1, 4, "f", 5), (2, 3, "r", 6)):
        nh, kb = valves.lever_ratio, valves.bar_stiffness
        torque = {"ph": kb * nh, f"z{left}": -kb * nh / (2 * c), f"z{right}": kb * nh / (2 * c)}
        torque[f"t{tag}"] = kb
        for part, gain in torque.items():
            a[at["dph"], at[part]] -= nh * gain
            a[at[f"dz{left}"], at[part]] += nh * gain / (2 * c)
            a[at[f"dz{right}"], at[part]] -= nh * gain / (2 * c)
            a[at[f"dt{tag}"], at[part]] -= gain
        w = valves.valve_frequency
        e[at[f"x{tag}"], at[f"x{tag}"]] = 1
        a[at[f"x{tag}"], at[f"dx{tag}"]] = 1
        e[at[f"dx{tag}"], at[f"dx{tag}"]] = 1 / w**2
        a[at[f"dx{tag}"], at[f"dx{tag}"]] = -2 * valves.valve_damping / w
        a[at[f"dx{tag}"], at[f"x{tag}"]] = -1
        b[at[f"dx{tag}"], u] = valves.valve_gain
        e[at[f"p{tag}"], at[f"p{tag}"]] = valves.volume / (4 * valves.bulk_modulus)
        a[at[f"p{tag}"], at[f"x{tag}"]] = valves.flow_gain
        a[at[f"p{tag}"], at[f"p{tag}"]] = -valves.pressure_coefficient - valves.leakage
        a[at[f"p{tag}"], at[f"dt{tag}"]] = valves.leakage_by_rotation - valves.displacement
        e[at[f"t{tag}"], at[f"t{tag}"]] = 1
        a[at[f"t{tag}"], at[f"dt{tag}"]] = 1
        e[at[f"dt{tag}"], at[f"dt{tag}"]] = valves.motor_inertia
        a[at[f"dt{tag}"], at[f"p{tag}"]] = valves.displacement
        a[at[f"dt{tag}"], at[f"dt{tag}"]] = -valves.motor_damping
    cf, cr = car.cornering
    front, rear = car.distance[0], -car.distance[1]
    e[at["be"], at["be"]] = car.mass * speed
    e[at["be"], at["dph"]] = -m * h
    a[at["be"], at["be"]] = -cf - cr
    a[at["be"], at["r"]] = -car.mass * speed - cf * front / speed + cr * rear / speed
    b[at["be"], 0] = cf
    e[at["r"], at["r"]] = car.yaw_inertia
    a[at["r"], at["be"]] = -front * cf + rear * cr
    a[at["r"], at["r"]] = -(front**2 * cf + rear**2 * cr) / speed
    b[at["r"], 0] = front * cf
    return np.linalg.solve(e, a), np.linalg.solve(e, b), at


OURS = {"zs": "heave", "th": "pitch", "ph": "roll", "dph": "roll_rate", "z1": "hop_fl"}
OURS |= {"z2": "hop_rl", "z3": "hop_rr", "z4": "hop_fr", "be": "sideslip", "r": "yaw_rate"}
OURS |= {"pf": "pressure_front", "tr": "angle_rear"}
ROADS = {1: "road_fl", 2: "road_rl", 3: "road_rr", 4: "road_fr"}
DRIVES = {0: "steer", 5: "current_front", 6: "current_rear"} | ROADS


@pytest.mark.parametrize("car", [AS_PRINTED, REPAIRED], ids=["as_printed", "repaired"])
def test_frequency_response_equals_python_control_on_the_printed_equations(car):
    a, b, at = descriptor(car, SPEED)
    omega = np.geomspace(0.1, 60.0, 25)
    reference = control.ss(a, b, np.eye(26), np.zeros((26, 7)))(1j * omega)
    ours = control.ss(*state_matrices(car, SPEED), np.eye(26), np.zeros((26, len(INPUTS))))(
        1j * omega
    )
    for theirs, name in OURS.items():
        for column, drive in DRIVES.items():
            mine = ours[STATES.index(name), INPUTS.index(drive)]
            other = reference[at[theirs], column]
            floor = 1e-3 * np.abs(reference[at["ph"], column]).max()
            floor *= 1e6 if name.startswith("pressure") else 1.0
            size = max(np.abs(other).max(), floor)
            assert np.abs(mine - other).max() <= 1e-7 * size, (theirs, drive)


def test_modes_of_the_repaired_car():
    """Heave near 1.3 Hz, four wheel hops between 9 and 11.5 Hz: the tyre is 250 kN/m."""
    a, _ = state_matrices(REPAIRED, SPEED)
    frequencies = np.abs(np.linalg.eigvals(a)) / (2 * np.pi)
    assert np.sum((frequencies > 9.0) & (frequencies < 11.6)) == 8
    assert np.any(np.abs(frequencies - 1.3) < 0.06)


def simulated(body, vehicle, seconds, speed=SPEED, **slots):
    state, parameters = body.build(vehicle, speed)
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    for name, value in slots.items():
        inputs[getattr(ports, name)] = value
    for _ in range(round(seconds * 1000)):
        open_loop.advance(body.step, state, inputs, parameters, outputs, 1e-3)
    return outputs


@pytest.mark.parametrize("name", vehicles.names())
def test_steady_turn_agrees_with_the_roll_plant(name):
    vehicle = vehicles.load(name)
    # the roll plant's wheels have no momentum
    vehicle = replace(vehicle, tyre=replace(vehicle.tyre, wheel_inertia=1e-6))
    full = simulated(bodies.body("linear_car"), vehicle, 8.0, STEER=0.005)
    roll = simulated(bodies.body("roll1"), vehicle, 8.0, STEER=0.005)
    assert full[ports.AY] == pytest.approx(roll[ports.AY], rel=1e-4)
    assert full[ports.ROLL] == pytest.approx(roll[ports.ROLL], rel=1e-3)
    moments = np.zeros(2)
    _, *tilts = steady_roll(vehicle, suspension_roll_stiffness(vehicle))
    for index, (axle, tilt) in enumerate(zip(axles(vehicle), tilts, strict=True)):
        transfers = [open_loop.load_transfer(x[None], index)[0] for x in (full, roll)]
        moments += np.array(transfers) * axle.share * axle.half_track
        # of the axle's roll on its tyres, which the roll plant has in one stiffness of both
        on_tyres = vehicle.tyre.vertical_stiffness * axle.half_track * tilt * full[ports.AY]
        assert transfers[0] == pytest.approx(on_tyres / axle.wheel_load, rel=1e-3)
    assert moments[0] == pytest.approx(moments[1], rel=0.02)


def test_step_equals_scipy():
    from scipy.linalg import expm

    vehicle = vehicles.load("van_real")
    _, parameters = bodies.body("linear_car_hydraulic").build(vehicle, 20.0)
    n = linear_car.N_LINEAR
    a, b = (parameters.view(linear_car.LINEAR_CAR)[0][name] for name in ("a", "b"))
    outputs = simulated(
        bodies.body("linear_car_hydraulic"),
        vehicle,
        0.5,
        speed=20.0,
        STEER=0.01,
        VALVE_CURRENT_REAR=-0.05,
    )
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n] = a
    augmented[:n, n] = b[:, INPUTS.index("steer")] * 0.01
    augmented[:n, n] += b[:, INPUTS.index("current_rear")] * -0.05
    expected = (expm(augmented * 0.5) @ np.eye(n + 1)[n])[:n]
    assert outputs[ports.ROLL] == pytest.approx(expected[STATES.index("roll")], rel=1e-6)
    assert outputs[ports.YAW_RATE] == pytest.approx(expected[STATES.index("yaw_rate")], rel=1e-6)


def test_valve_current_rolls_the_body_and_meets_its_limits():
    vehicle = vehicles.load("van_real")
    body = bodies.body("linear_car_hydraulic")
    pushed = simulated(body, vehicle, 4.0, VALVE_CURRENT_FRONT=0.5)
    other = simulated(body, vehicle, 4.0, VALVE_CURRENT_FRONT=-0.5)
    assert pushed[ports.ROLL] == pytest.approx(-other[ports.ROLL], rel=1e-9)
    assert abs(pushed[ports.ROLL]) > 1e-3
    assert np.sign(pushed[ports.BAR_MOMENT]) == np.sign(pushed[ports.ROLL])
    valves = vehicle.actuators.valves
    hard = simulated(body, vehicle, 4.0, VALVE_CURRENT_FRONT=100.0)
    assert abs(hard[ports.BAR_PRESSURE]) <= valves.supply_pressure * (1 + 1e-12)
    assert abs(hard[ports.BAR_ANGLE]) <= valves.angle_limit * (1 + 1e-12)


def test_one_sided_road_rolls_the_body():
    outputs = simulated(bodies.body("linear_car"), vehicles.load("van_real"), 3.0, ROAD_HEIGHT=0.02)
    assert outputs[ports.ROLL] > 0 and outputs[ports.PITCH] < 0


def test_linearisation_keeps_mass_and_axles():
    vehicle = vehicles.load("van_real")
    car = from_vehicle(vehicle, suspension_stiffness=vehicle.plant.roll_stiffness)
    assert car.mass == vehicle.total_mass and car.valves is None
    parameters = linear_car.parameters_of(car, 10.0).view(linear_car.LINEAR_CAR)[0]
    static = parameters["axle"]["wheel_load"]
    assert 2 * static.sum() == pytest.approx(vehicle.total_mass * vehicles.GRAVITY, rel=1e-12)


CARS = st.tuples(
    st.sampled_from(vehicles.names()),
    st.lists(st.floats(-0.1, 0.1), min_size=16, max_size=16),
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.3, 0.3)),
    st.lists(st.floats(-2000, 2000), min_size=6, max_size=6),
)


@given(CARS)
def test_momentum_and_its_moment_about_the_road_change_by_the_road_alone(drawn):
    """The linear balances, with masses at their heights and loads where the contact patches are."""
    name, values, (steer, bank), forces = drawn
    vehicle, speed = vehicles.load(name), 25.0
    geometry, plant = vehicle.geometry, vehicle.plant
    state, parameters = bodies.body("linear_car").build(vehicle, speed)
    state[: len(values)] = values
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    inputs[ports.STEER], inputs[ports.BANK] = steer, bank
    inputs[ports.CORNER_FORCE : ports.CORNER_FORCE + 6] = forces
    rate = np.zeros_like(state)
    linear_car.derivative(state, inputs, parameters, rate)
    linear_car._observe(state, inputs, parameters, outputs)
    static_loads = parameters.view(linear_car.LINEAR_CAR)[0]["axle"]["wheel_load"]
    loads = np.repeat(static_loads, 2)
    hops = state[linear_car.HOP : linear_car.HOP + 4]
    loads = loads - vehicle.tyre.vertical_stiffness * hops
    loads = loads - vehicle.tyre.vertical_damping * state[linear_car.HOP_RATE :][:4]

    roll, roll_acc = state[linear_car.ROLL], rate[linear_car.RATES + 2]
    yaw_rate, yaw_acc = state[linear_car.YAW_RATE], rate[linear_car.YAW_RATE]
    g, arm, axis = vehicles.GRAVITY, plant.cg_height_above_roll_axis, vehicle.roll_axis_height
    aside = speed * (rate[linear_car.SIDESLIP] + yaw_rate)
    sprung = aside + vehicle.sprung_cg_offset * yaw_acc - arm * roll_acc
    normal = g * (np.cos(bank) - 1) - speed * yaw_rate * np.tan(bank)
    momentum = plant.sprung_mass * sprung
    lifted = plant.sprung_mass * (rate[linear_car.RATES] + normal)
    moment = plant.inertia_about_cg * roll_acc - plant.sprung_mass * (axis + arm) * sprung
    moment -= plant.sprung_mass * g * (arm * roll + (axis + arm) * np.sin(bank))
    for axle, (ahead, track, height, m) in enumerate(axles_of(vehicle)):
        left, right = hops[2 * axle : 2 * axle + 2]
        accelerations = rate[linear_car.HOP_RATE + 2 * axle :][:2]
        tilt = (left - right) / (2 * track)
        tilt_acc = (accelerations[0] - accelerations[1]) / (2 * track)
        above = vehicle.tyre.radius - height
        axle_aside = aside + ahead * yaw_acc + (axis - height) * roll_acc - above * tilt_acc
        momentum += m * axle_aside
        lifted += m * (accelerations.mean() + normal)
        hub, patch = (axis - height) * roll - above * tilt, (axis - height) * roll + height * tilt
        moment += m * track**2 * tilt_acc - m * vehicle.tyre.radius * axle_aside
        moment += m * g * (hub - vehicle.tyre.radius * np.sin(bank))
        spin = 2 * vehicle.tyre.wheel_inertia * speed / vehicle.tyre.radius
        moment -= spin * yaw_rate
        static = 2 * static_loads[axle]
        moment -= track * (loads[2 * axle] - loads[2 * axle + 1]) + static * patch
    pushed = outputs[ports.LATERAL_FORCE : ports.LATERAL_FORCE + 4].sum()
    weight = vehicle.total_mass * g
    assert momentum == pytest.approx(pushed - weight * np.sin(bank), abs=1e-9 * weight)
    assert lifted == pytest.approx(loads.sum() - weight, abs=1e-9 * weight)
    assert moment == pytest.approx(0.0, abs=1e-9 * weight * geometry.wheelbase)
    assert outputs[ports.BODY_ACC + 1] == pytest.approx(sprung, abs=1e-9 * g)


def test_a_banked_curve_presses_the_roll_plant_too():
    """Σ loads = m (g cos η − v r tan η), of a car that turns with the bank."""
    vehicle = vehicles.load("van_real")
    outputs = simulated(bodies.body("roll1"), vehicle, 6.0, STEER=0.02, BANK=-0.2)
    loads = outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4].sum()
    normal = vehicles.GRAVITY * np.cos(0.2) + SPEED * outputs[ports.YAW_RATE] * np.tan(0.2)
    assert loads == pytest.approx(vehicle.total_mass * normal, rel=1e-9)
