"""Toe and camber of the 14-DOF car's wheels by tables of kinematics and compliance."""

from math import degrees, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from support.balance import Balance
from support.car_bodies import pitched, rolled, steered

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import curves, nonlinear_car, parameters, ports
from canroll.plant_sim.bodies.contact import LEFT
from canroll.plant_sim.driving.maneuvers import build
from canroll.plant_sim.world import handling, open_loop
from canroll.vehicles.axles import axles
from canroll.vehicles.unladen import unladen

BODY = bodies.body("nonlinear")
TYRE = Path(__file__).parents[2] / "vehicles" / "tyres" / "passenger_61.tir"
INWARDS = np.array([-1, 1, -1, 1])
"""To the left, of what counts inwards on each wheel."""
BY_FORCE, BY_MOMENT = "side_force", "aligning_moment"
UNITS = {"compression": "m", BY_FORCE: "N", BY_MOMENT: "N·m"}


def table(x, reach, **lines):
    """Straight lines (value at 0, slope) over x."""
    columns = {f"{x} [{UNITS[x]}]": [-reach, reach]}
    for name, (rest, slope) in lines.items():
        columns[f"{name} [rad]"] = [rest - slope * reach, rest + slope * reach]
    return columns


def travelling(**lines):
    return {"kinematics": table("compression", 0.1, **lines)}


def pushed(**lines):
    return {BY_FORCE: table(BY_FORCE, 5e3, **lines)}


def twisted(**lines):
    return {BY_MOMENT: table(BY_MOMENT, 200.0, **lines)}


def car(front=None, rear=None, *, tyre=False):
    given = {"base": "sedan_320i", "title": "of tables"}
    if front or rear:
        given["axles"] = {n: t for n, t in (("front", front), ("rear", rear)) if t}
    return vehicles.load(given | ({"tyre": {"file": str(TYRE)}} if tyre else {}))


KINEMATIC = (
    travelling(toe=(0.004, -0.15), camber=(-0.01, -0.4)),
    travelling(toe=(0.003, 0.1), camber=(-0.015, -0.6)),
)
COMPLIANT = (
    pushed(toe=(0.0, -1.5e-6), camber=(0.0, 3e-6)) | twisted(toe=(0.0, 5e-5), camber=(0, 1e-5)),
    pushed(toe=(0.0, 0.5e-6), camber=(0.0, 2e-6)) | twisted(toe=(0.0, 2e-5), camber=(0, 1e-5)),
)
WHOLE = tuple(one | other for one, other in zip(KINEMATIC, COMPLIANT, strict=True))


def evaluated(vehicle, state, steer=0.0):
    inputs = ports.initial_inputs()
    inputs[ports.STEER] = steer
    rate, results = np.zeros(nonlinear_car.N_STATES), np.zeros(nonlinear_car.N_RESULTS)
    nonlinear_car.evaluate(state, inputs, BODY.build(vehicle, 20.0)[1], rate, results)
    return inputs, results


def of_wheels(results, slot):
    return results[slot : slot + 4]


def lines_of(tables, name):
    """Its lines over compression, force and moment, (3, 2)."""
    lines = []
    for kind, x in (("kinematics", "compression"), (BY_FORCE, BY_FORCE), (BY_MOMENT, BY_MOMENT)):
        columns = tables.get(kind, {})
        reach = columns.get(f"{x} [{UNITS[x]}]", [0.0, 1.0])[1]
        low, high = columns.get(f"{name} [rad]", [0.0, 0.0])
        lines.append((0.5 * (low + high), 0.5 * (high - low) / reach))
    return np.array(lines)


def attitudes(both, name, state, aside, aligning):
    """Toe or camber of each wheel, straight from the tables."""
    compression = -state[nonlinear_car.TRAVEL : nonlinear_car.TRAVEL + 4]
    x = np.array([compression, INWARDS * aside, INWARDS * aligning])
    lines = np.array([lines_of(both[wheel // 2], name) for wheel in range(4)])
    return sum(lines[:, k, 0] + lines[:, k, 1] * x[k] for k in range(3))


def moments(vehicle, load, ratio, slip, lean):
    tyres = [axle.tyre for axle in axles(vehicle) for _ in range(2)]
    return np.array(
        [
            tyres[w].forces(load[w], ratio[w], slip[w], lean[w], 1.0, -float(INWARDS[w]))
            for w in range(4)
        ]
    )


@pytest.mark.parametrize(("both", "close"), [(KINEMATIC, 1e-9), (WHOLE, 2e-6)])
def test_a_wheel_has_the_force_of_its_tyre_at_its_inclination_and_slip(both, close):
    vehicle = car(*both, tyre=True)
    state, _ = steered(vehicle, 0.04, 1.5)
    steer = 0.04
    inputs, results = evaluated(vehicle, state, steer)
    aside, load = of_wheels(results, nonlinear_car.R_LATERAL), of_wheels(results, 0)
    aligning = np.zeros(4)
    # what the tyre says of the moment follows from the same wheel
    for _ in range(20):
        turned = INWARDS * attitudes(both, "toe", state, aside, aligning)
        camber = INWARDS * attitudes(both, "camber", state, aside, aligning)
        balance = Balance(vehicle, state, inputs, turned)
        ratio, lean = np.zeros(4), np.zeros(4)
        for wheel, road in enumerate(balance.road):
            axis = balance.bodies.hubs[wheel].axis
            ahead = np.cross(axis, [0, 0, 1]) / sqrt(1 - axis[2] ** 2)
            along = road["slip"] @ ahead
            spin = state[nonlinear_car.SPIN + wheel] * vehicle.tyre.radius
            ratio[wheel] = (spin - along) / along
            angle = turned[wheel] + (steer if wheel < 2 else 0.0)
            upright = np.array([-np.sin(angle), np.cos(angle), 0.0])
            attitude = rolled(state[nonlinear_car.ROLL] + camber[wheel])
            lean[wheel] = (pitched(state[nonlinear_car.PITCH]) @ attitude @ upright)[2]
        slip = of_wheels(state, nonlinear_car.SLIP)
        forces = moments(vehicle, load, ratio, slip, lean)
        aligning = forces[:, 2]
    assert abs(lean).min() > 0.02 and abs(turned).min() > 5e-4
    np.testing.assert_allclose(aside, forces[:, 1], rtol=0, atol=close * load.max())
    longitudinal = of_wheels(results, nonlinear_car.R_LONGITUDINAL)
    np.testing.assert_allclose(longitudinal, forces[:, 0], rtol=0, atol=close * load.max())


def test_camber_that_follows_the_roll_is_that_of_a_rigid_axle():
    tracks = [axle.half_track for axle in axles(car())]
    rigid = [travelling(camber=(0.0, -1.0 / track)) for track in tracks]
    beam, tables = car(tyre=True), car(*rigid, tyre=True)
    state, _ = BODY.build(beam, 20.0)
    state[nonlinear_car.ROLL], state[nonlinear_car.SLIP : nonlinear_car.SLIP + 4] = 0.06, 0.01
    for axle, track in enumerate(tracks):
        # the axle is rolled by 0.01 towards the other side
        first = nonlinear_car.TRAVEL + 2 * axle
        state[first], state[first + 1] = 0.07 * track, -0.07 * track
    found, wanted = (
        of_wheels(evaluated(each, state)[1], nonlinear_car.R_LATERAL) for each in (tables, beam)
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
    other = of_wheels(evaluated(car(*KINEMATIC, tyre=True), state)[1], nonlinear_car.R_LATERAL)
    assert (abs(other - wanted) > 10.0).all()


def test_thrust_of_static_camber_is_that_of_the_tyre():
    vehicle = car(travelling(camber=(0.03, 0.0)), travelling(camber=(-0.02, 0.0)), tyre=True)
    state, _ = BODY.build(vehicle, 20.0)
    aside = of_wheels(evaluated(vehicle, state)[1], nonlinear_car.R_LATERAL)
    for wheel, camber in enumerate((0.03, 0.03, -0.02, -0.02)):
        axle = axles(vehicle)[wheel // 2]
        hand = -float(INWARDS[wheel])
        wanted = axle.tyre.forces(axle.wheel_load, 0.0, 0.0, sin(-hand * camber), 1.0, hand)
        assert aside[wheel] == pytest.approx(wanted[1], rel=1e-9)
    # a top that leans outwards pulls outwards
    upright = of_wheels(evaluated(car(tyre=True), state)[1], nonlinear_car.R_LATERAL)
    assert aside[0] > upright[0] + 20.0 and aside[2] < upright[2] - 20.0


def steady(vehicle, lateral):
    """Steering beyond that of the curve, and roll between body and axles, per acceleration."""
    speed, radius = sqrt(lateral * 100.0), 100.0
    maneuver = build("constant_radius", vehicle, speed, radius=radius)
    outputs, steer = open_loop.run_passive(vehicle, BODY, maneuver)
    last = outputs[-handling.SETTLED :].mean(axis=0)
    beyond = steer[-handling.SETTLED :].mean()
    beyond -= vehicle.geometry.wheelbase * last[ports.AY] / last[ports.VX] ** 2
    travel = last[ports.TRAVEL : ports.TRAVEL + 4]
    rolls = [
        (travel[2 * k] - travel[2 * k + 1]) / (2 * axle.half_track)
        for k, axle in enumerate(axles(vehicle))
    ]
    return beyond / last[ports.AY], np.array(rolls) / last[ports.AY]


@pytest.fixture(scope="module")
def plain():
    return steady(car(), 0.5)


@pytest.mark.parametrize("axle", [0, 1])
def test_roll_steer_adds_its_coefficient_times_the_roll_gradient(plain, axle):
    slope = (-0.2, 0.2)[axle]
    tables = [None, None]
    tables[axle] = travelling(toe=(0.0, slope))
    vehicle = car(*tables)
    found, _ = steady(vehicle, 0.5)
    # Gillespie, Fundamentals of Vehicle Dynamics, chapter 6: (ε_f − ε_r) dφ/da_y, ε per roll
    per_roll = slope * axles(vehicle)[axle].half_track
    wanted = (-1, 1)[axle] * per_roll * plain[1][axle]
    assert wanted > 0.001
    assert found - plain[0] == pytest.approx(wanted, rel=0.01)
    assert vehicle.understeer - car().understeer == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("axle", [0, 1])
def test_compliance_steer_adds_its_coefficient_times_the_axle_force(plain, axle):
    slope = (-2e-6, 2e-6)[axle]
    tables = [None, None]
    tables[axle] = pushed(toe=(0.0, slope))
    vehicle = car(*tables)
    found, _ = steady(vehicle, 0.5)
    # Gillespie: A_f W_f − A_r W_r, A per side force of the axle, on two wheels
    geometry = vehicle.geometry
    share = (geometry.static_front_share, 1 - geometry.static_front_share)[axle]
    wanted = (-1, 1)[axle] * 0.5 * slope * share * vehicle.total_mass
    assert found - plain[0] == pytest.approx(wanted, rel=0.015)
    assert vehicle.understeer - car().understeer == pytest.approx(wanted, rel=1e-9)


def test_steer_by_aligning_torque_is_its_compliance_times_the_moment():
    stiff, soft = (car(front, tyre=True) for front in (None, twisted(toe=(0.0, 2e-4))))
    before, moment = circling(stiff)
    after, _ = circling(soft)
    # the moment turns both front wheels out of the curve
    assert moment < -5.0
    assert after - before == pytest.approx(-2e-4 * moment, rel=0.01)


def circling(vehicle, steer=0.03):
    """Steering beyond that of the curve per acceleration, mean moment of the front wheels alike."""
    state, outputs = steered(vehicle, steer, 6.0, 7.0)
    lateral = outputs[ports.AY]
    beyond = steer - vehicle.geometry.wheelbase * lateral / outputs[ports.VX] ** 2
    forces = moments(
        vehicle,
        outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4],
        np.zeros(4),
        of_wheels(state, nonlinear_car.SLIP),
        np.zeros(4),
    )
    return beyond / lateral, forces[:2, 2].mean() / lateral


def test_toe_of_a_straight_car_brakes_and_nothing_else():
    toe = 0.01
    wheels = travelling(toe=(toe, 0.0))
    state, outputs = steered(car(wheels, wheels), 0.0, 2.0)
    plain_state, _ = steered(car(), 0.0, 2.0)
    left = outputs[ports.LATERAL_FORCE : ports.LATERAL_FORCE + 4]
    # toe-in pushes each wheel towards the middle
    assert (INWARDS * left > 100.0).all()
    assert abs(left.sum()) < 1e-6 and abs(state[[1, 2, 4]]).max() < 1e-9
    stiffness = sum(axle.cornering for axle in axles(car()))
    slower = stiffness * toe**2 / car().total_mass * 2.0
    lost = plain_state[nonlinear_car.VX] - state[nonlinear_car.VX]
    assert lost == pytest.approx(slower, rel=0.1)


@pytest.mark.parametrize("tyre", [False, True])
def test_mirrored_steering_gives_the_mirrored_run(tyre):
    vehicle = car(*WHOLE, tyre=tyre)
    left, right = (steered(vehicle, steer, 1.5)[1] for steer in (0.05, -0.05))
    for slot in (ports.Y, ports.YAW, ports.ROLL, ports.AY, ports.VY, ports.YAW_RATE):
        assert left[slot] == pytest.approx(-right[slot], rel=1e-10)
    for slot in (ports.WHEEL_LOAD, ports.TRAVEL):
        mirrored = right[[slot + 1, slot, slot + 3, slot + 2]]
        assert left[slot : slot + 4] == pytest.approx(mirrored, rel=1e-10)


def test_curves_are_read_from_where_the_car_stands():
    bent = {
        "spring": {"compression [m]": [0.0, 0.25], "force [N]": [0.0, 6250.0]},
        "kinematics": {
            "compression [mm]": [-60, 0, 20, 60],
            "toe [deg]": [-0.2, 0.1, 0.15, 0.6],
        },
    }
    vehicle = car(bent)
    record = parameters.build_parameters(vehicle).view(parameters.CAR)[0]
    assert record["attitudes"] == 1.0
    for each in (vehicle, unladen(vehicle), vehicle.replace({"plant.sprung_mass": 1200.0})):
        rest = axles(each)[0].curves.rest
        state, _ = BODY.build(each, 20.0)
        state[nonlinear_car.TRAVEL] = -0.01
        state[nonlinear_car.SLIP : nonlinear_car.SLIP + 4] = 0.02
        _, results = evaluated(each, state)
        # the left front wheel's force in its own axes and in the car's
        along, across = results[[nonlinear_car.R_LONGITUDINAL, nonlinear_car.R_LATERAL]]
        x, y = results[[nonlinear_car.FORWARD, LEFT]]
        toe = np.arctan2(across, along) - np.arctan2(y, x)
        wanted = np.interp(1e3 * (rest + 0.01), [-60, 0, 20, 60], [-0.2, 0.1, 0.15, 0.6])
        assert degrees(toe) == pytest.approx(wanted, abs=1e-4)


def test_how_often_the_attitude_is_determined():
    def attitudes_of(*both):
        return parameters.build_parameters(car(*both)).view(parameters.CAR)[0]["attitudes"]

    assert attitudes_of() == 0.0
    assert attitudes_of(KINEMATIC[0]) == attitudes_of(None, KINEMATIC[1]) == 1.0
    assert attitudes_of(COMPLIANT[0]) == attitudes_of(*WHOLE) == curves.COMPLIANT


def test_linear_plants_say_that_they_have_none():
    vehicle = car(KINEMATIC[0])
    assert list(BODY.left_out(vehicle)) == []
    for name in ("roll1", "linear_car"):
        assert list(bodies.body(name).left_out(car())) == []
        (line,) = bodies.body(name).left_out(vehicle)
        assert f"no effect on {name}" in line and "--plant nonlinear" in line
