"""The smart actuator node: end-to-end protection, hold, timeout, report, and the four kinds."""

import dataclasses
import math

import numpy as np
import pytest
from e2e import p01
from scipy import integrate

from canroll import dbc, vehicles
from canroll.errors import CanrollError, UnknownNameError
from canroll.firmware import calibration as fw
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.kernels.schedule import ScheduledFault
from canroll.plant_sim.nodes import (
    actuator_kernel,
    actuator_models,
    codec,
    codec_tables,
    hydraulics,
)
from canroll.plant_sim.nodes import actuators as actuator_setup
from canroll.plant_sim.nodes.actuators import ActuatorOptions
from canroll.vehicles.actuators import ACTUATORS

VEHICLE = vehicles.load("van_real")
MS = 1_000_000


def roomy(**changes):
    """The vehicle with actuators that no limit binds."""
    data = VEHICLE.actuators
    wide = {"force_limit": 4000.0, "force_rate_limit": math.inf, "power_limit": math.inf}
    return dataclasses.replace(
        VEHICLE,
        actuators=dataclasses.replace(
            data, suspension=dataclasses.replace(data.suspension, **{**wide, **changes})
        ),
    )


class Rig:
    """A node on a bench: frames go in by hand, strokes are prescribed."""

    def __init__(self, kind, *, vehicle=VEHICLE, enabled=True, timeout_ms=160.0, **options):
        self.node = actuator_setup.build(
            vehicle,
            kind,
            options=ActuatorOptions(**options),
            enabled=enabled,
            timeout_ms=timeout_ms,
        )
        self.inputs, self.outputs = np.zeros(ports.N_INPUTS), np.zeros(ports.N_OUTPUTS)
        self.counter = 0
        self.t = 0

    def send(self, message, *, counter=None, flip=0, **values):
        entry = dbc.load().get_message_by_name(message)
        plain = {s.name: 0 for s in entry.signals}
        data = bytearray(entry.encode({**plain, **values}, strict=False))
        data[1] = data[1] & 0xF0 | (self.counter if counter is None else counter)
        p01.e2e_p01_protect(data, dbc.data_id(entry), length=8, increment_counter=False)
        word = (int.from_bytes(data, "little") ^ flip) & (1 << 64) - 1
        payload = np.frombuffer(word.to_bytes(8, "little"), np.uint8)
        self.counter = (self.counter + 1) % 15
        which = actuator_kernel.listens(self.node, codec_tables.message_index(message))
        assert which >= 0
        return actuator_kernel.receive(self.node, codec_tables.load(), which, payload, self.t)

    def run(self, ms, each=None):
        trace = []
        for _ in range(ms):
            if each:
                each(self)
            actuator_kernel.supervise(self.node, self.t)
            actuator_models.act(self.node, self.outputs, self.inputs, self.t)
            self.t += MS
            trace.append(self.delivered.copy())
        return np.array(trace)

    @property
    def delivered(self):
        return self.node["delivered"]

    @property
    def forces(self):
        return self.inputs[ports.CORNER_FORCE : ports.CORNER_FORCE + 4]

    @property
    def report(self):
        payload = np.zeros(codec.MAX_PAYLOAD, np.uint8)
        message = codec_tables.message_index("ActuatorState")
        actuator_kernel.report(self.node, codec_tables.load(), message, payload, False)
        data = payload[:8].tobytes()
        return dbc.load().get_message_by_name("ActuatorState").decode(data, decode_choices=False)


def moment(force):
    """Commands for a pure roll moment, ``force`` up on the left."""
    return {
        "ForceFrontLeft": force,
        "ForceFrontRight": -force,
        "ForceRearLeft": force,
        "ForceRearRight": -force,
    }


def test_a_command_is_followed_with_the_lag_and_lifts_the_left():
    rig = Rig("suspension", vehicle=roomy())
    assert rig.send("SuspensionForceCommand", **moment(1000))
    rig.run(20)
    lag = VEHICLE.actuators.suspension.lag
    mean = 1000 * (1 - (math.exp(-0.019 / lag) + math.exp(-0.020 / lag)) / 2)
    assert rig.forces == pytest.approx([mean, -mean, mean, -mean])
    track = VEHICLE.geometry.half_track_front
    assert rig.delivered[0] == pytest.approx(2 * mean * track)
    assert rig.delivered[0] > 0


def test_nothing_is_delivered_before_the_first_command_and_the_report_says_so():
    rig = Rig("suspension")
    rig.run(50)
    assert not rig.forces.any()
    report = rig.report
    assert (report["CommandHeld"], report["AcceptedCounter"], report["Enabled"]) == (0, 15, 1)


def test_the_echo_is_the_accepted_counter():
    rig = Rig("suspension")
    for k in range(33):
        assert rig.send("SuspensionForceCommand", **moment(100))
        assert rig.report["AcceptedCounter"] == k % 15
        rig.run(10)


def test_a_damaged_or_repeated_frame_is_not_taken():
    rig = Rig("suspension", vehicle=roomy())
    assert rig.send("SuspensionForceCommand", **moment(500))
    assert not rig.send("SuspensionForceCommand", flip=1 << 30, **moment(3000))
    assert not rig.send("SuspensionForceCommand", counter=0, **moment(3000))
    rig.run(200)
    assert rig.node["rejected"] == 2
    assert abs(rig.forces).max() <= 500


def test_lost_frames_within_the_limit_are_forgiven_and_beyond_it_synchronised():
    rig = Rig("suspension")
    assert rig.send("SuspensionForceCommand", counter=0)
    assert rig.send("SuspensionForceCommand", counter=3)
    assert not rig.send("SuspensionForceCommand", counter=12)
    assert not rig.send("SuspensionForceCommand", counter=13)
    assert rig.send("SuspensionForceCommand", counter=14)


@pytest.mark.parametrize("force", [500, 2000])
def test_the_command_is_held_until_the_timeout_then_fades_in_a_period_of_the_roll(force):
    rig = Rig("suspension", vehicle=roomy(), timeout_ms=160.0)
    fades = round(1e3 * roomy().plant.roll_period)
    rig.send("SuspensionForceCommand", **moment(force))
    trace = rig.run(161)
    assert rig.report["CommandHeld"] == 1
    assert trace[-1] == pytest.approx(trace[120], rel=1e-3)
    rig.run(1)
    assert rig.report["CommandHeld"] == 0
    falling = rig.run(fades + 100)[:, 0]
    assert falling[fades // 2] == pytest.approx(0.5 * trace[-1, 0], rel=0.05)
    assert (np.diff(falling) <= 0).all()
    assert falling[-1] == pytest.approx(0.0, abs=1.0)


def test_renewal_keeps_the_command_alive():
    rig = Rig("suspension")
    for _ in range(20):
        rig.send("SuspensionForceCommand", **moment(1000))
        rig.run(150)
        assert rig.report["CommandHeld"] == 1
    assert rig.forces[0] == pytest.approx(1000)


def test_a_disabled_node_acknowledges_and_delivers_nothing():
    for kind, message, values in [
        ("suspension", "SuspensionForceCommand", moment(1000)),
        ("bars", "AntiRollBarCommand", {"TorqueFront": 1000}),
        ("dampers", "DamperCommand", {"CurrentFrontLeft": 1600}),
        ("valves", "AntiRollBarCommand", {"TorqueFront": 1000}),
    ]:
        rig = Rig(kind, enabled=False)
        rig.outputs[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4] = [0.2, -0.2, 0.2, -0.2]
        assert rig.send(message, **values)
        rig.run(100)
        assert not rig.inputs.any()
        assert (rig.report["Enabled"], rig.report["AcceptedCounter"]) == (0, 0)


def test_force_and_rate_limits_bind_and_are_reported():
    rig = Rig("suspension", vehicle=roomy(force_rate_limit=20_000.0, force_limit=1500.0))
    rig.send("SuspensionForceCommand", **moment(3000))
    rig.run(10)
    assert abs(rig.node["reference"][0]) == pytest.approx(200.0)
    assert rig.report["StatusFrontLeft"] == actuator_kernel.STATUS_LIMITED
    rig.run(140)
    assert rig.forces[0] == pytest.approx(1500.0, rel=3e-3)
    assert rig.forces[0] <= 1500.0


def test_power_limit_binds_only_where_power_is_delivered():
    rig = Rig("suspension", vehicle=roomy(power_limit=500.0))
    rig.outputs[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4] = [0.5, 0.5, -0.5, -0.5]
    rig.send("SuspensionForceCommand", **moment(2000))
    rig.run(150)
    assert rig.forces == pytest.approx([1000, -2000, 2000, -1000], rel=1e-3)


def test_error_codes_demand_nothing():
    entry = dbc.load().get_message_by_name("SuspensionForceCommand")
    code = next(
        r
        for r, t in entry.get_signal_by_name("ForceFrontLeft").choices.items()
        if str(t) == "Error"
    )
    rig = Rig("suspension")
    rig.send("SuspensionForceCommand", **{**moment(1000), "ForceFrontLeft": code * 2})
    rig.run(100)
    assert rig.forces[0] == 0.0
    assert rig.forces[2] == pytest.approx(1000, rel=1e-2)


@pytest.mark.parametrize("error", [-0.2, 0.0, 0.2])
def test_the_delivered_moment_is_an_estimate(error):
    rig = Rig("suspension", estimate_error=error, estimate_lag=0.02)
    rig.send("SuspensionForceCommand", **moment(1000))
    rig.run(30)
    true = rig.delivered[0]
    assert rig.report["DeliveredMomentFront"] < true * (1 + error) * 0.95
    rig.run(120)
    true = rig.delivered[0]
    assert rig.report["DeliveredMomentFront"] == pytest.approx(true * (1 + error), rel=4e-3)


@pytest.mark.parametrize(
    ("kind", "status", "share"),
    [
        ("stuck", actuator_kernel.STATUS_STUCK, 1.0),
        ("floating", actuator_kernel.STATUS_FLOATING, 0.0),
        ("weak", actuator_kernel.STATUS_LIMITED, 0.3),
    ],
)
@pytest.mark.parametrize("corner", range(4))
def test_faults_of_a_corner(kind, status, share, corner):
    name = actuator_setup.CORNERS[corner]
    fault = ScheduledFault(where=name, kind=kind, start=0.2, value=0.3)
    rig = Rig("suspension", faults=(fault,), timeout_ms=1e6)
    rig.send("SuspensionForceCommand", **moment(1000))
    rig.run(200)
    before = rig.forces.copy()
    assert (
        rig.report["StatusFrontLeft"] == actuator_kernel.STATUS_LIMITED
    )  # the rise, kept till sent
    rig.send("SuspensionForceCommand", **moment(500 if kind == "stuck" else 1000))
    rig.run(100)
    assert rig.report
    rig.run(100)
    assert rig.forces[corner] == pytest.approx(share * before[corner], rel=1e-2, abs=1e-2)
    signals = ("StatusFrontLeft", "StatusFrontRight", "StatusRearLeft", "StatusRearRight")
    report = list(map(rig.report.get, signals))
    assert report[corner] == status
    assert all(s == actuator_kernel.STATUS_OK for i, s in enumerate(report) if i != corner)


def after_fault(kind, demand=600.0, ms=300, **options):
    """Bars at a steady ``demand`` (N·m), ``ms`` after a fault of the front one."""
    faults = (ScheduledFault(where="front", kind=kind, start=0.2, **options),)
    rig = Rig("bars", faults=faults, timeout_ms=1e6)
    rig.send("AntiRollBarCommand", TorqueFront=demand, TorqueRear=demand)
    rig.run(200)
    assert rig.delivered == pytest.approx([demand, demand], rel=1e-3)
    assert rig.report
    rig.run(ms)
    assert rig.delivered[1] == pytest.approx(demand, rel=1e-3)
    return rig


@pytest.mark.parametrize(
    ("kind", "options", "expected", "status"),
    [
        ("dead", {}, 0.0, actuator_kernel.STATUS_OK),
        ("reversed", {}, -600.0, actuator_kernel.STATUS_OK),
        ("reversed", {"ramp": 0.6}, 0.0, actuator_kernel.STATUS_OK),
        ("runaway", {"value": -0.5}, -400.0, actuator_kernel.STATUS_OK),
        ("derating", {"value": 0.1}, 200.0, actuator_kernel.STATUS_LIMITED),
        ("derating", {"value": 0.9}, 600.0, actuator_kernel.STATUS_OK),
        ("floating", {"ramp": 0.6}, 300.0, actuator_kernel.STATUS_FLOATING),
    ],
)
def test_a_fault_of_an_axle(kind, options, expected, status):
    rig = after_fault(kind, **options)
    assert rig.delivered[0] == pytest.approx(expected, abs=25.0)
    rig.run(1)
    assert rig.report["StatusFrontLeft"] in {status, actuator_kernel.STATUS_LIMITED}
    assert rig.report["StatusFrontLeft"] == status
    assert rig.report["DeliveredMomentFront"] == pytest.approx(rig.delivered[0], abs=25.0)


def test_a_slow_bar_has_the_stated_lag():
    rig = after_fault("slow", value=20.0, demand=0.0, ms=0)
    rig.send("AntiRollBarCommand", TorqueFront=100, TorqueRear=100)
    rig.run(200)
    assert rig.delivered[0] == pytest.approx(100 * (1 - math.exp(-1)), rel=0.03)
    assert rig.delivered[1] == pytest.approx(100, rel=1e-3)


@pytest.mark.parametrize("kind", ["dead", "reversed", "floating", "stuck"])
def test_a_lying_bar_reports_what_it_was_commanded(kind):
    faults = (
        ScheduledFault(where="front", kind=kind, start=0.2),
        ScheduledFault(where="front", kind="lying", start=0.2),
    )
    rig = Rig("bars", faults=faults, timeout_ms=1e6)
    rig.send("AntiRollBarCommand", TorqueFront=600, TorqueRear=600)
    rig.run(200)
    assert rig.report
    rig.send("AntiRollBarCommand", TorqueFront=-300, TorqueRear=-300)
    rig.run(300)
    assert rig.report
    assert abs(rig.delivered[0] + 300) > 200
    assert rig.report["StatusFrontLeft"] == actuator_kernel.STATUS_OK
    assert rig.report["DeliveredMomentFront"] == pytest.approx(-300, abs=4)


@pytest.mark.parametrize("kind", ["dead", "derating", "reversed", "runaway", "slow", "weak"])
def test_valves_fail_in_the_same_ways(kind):
    value = {"derating": 0.02, "runaway": 0.9, "slow": 50.0, "weak": 0.02}.get(kind, 0.5)
    faults = (ScheduledFault(where="front", kind=kind, value=value),)
    rig = Rig("valves", faults=faults, timeout_ms=1e6)
    rig.send("AntiRollBarCommand", TorqueFront=500, TorqueRear=500)
    rig.run(250)
    assert rig.delivered[1] == pytest.approx(500, abs=25)
    assert abs(rig.delivered[0] - 500) > 50
    if kind == "reversed":
        assert rig.delivered[0] == pytest.approx(-500, abs=25)


def test_cold_oil_slows_and_low_supply_weakens():
    def after(ms, **options):
        rig = Rig("suspension", vehicle=roomy(), **options)
        rig.send("SuspensionForceCommand", **moment(4000))
        rig.run(ms)
        return rig

    assert after(20, oil_temperature=-10).forces[0] < 0.5 * after(20).forces[0]
    assert after(150, supply=10.0).forces[0] == pytest.approx(4000 * 10 / 13.5, rel=1e-3)
    off = after(150, supply=8.0)
    assert off.forces[0] == 0
    assert off.report["StatusRearRight"] == actuator_kernel.STATUS_FLOATING


def test_bars_follow_in_ten_milliseconds_to_two_kilonewtonmetres():
    data = VEHICLE.actuators.bars
    assert (data.lag, data.torque_limit) == (0.01, 2000.0)
    rig = Rig("bars")
    rig.send("AntiRollBarCommand", TorqueFront=500, TorqueRear=-5000)
    rig.run(150)
    assert rig.inputs[ports.BAR_MOMENT_FRONT] == pytest.approx(500)
    assert rig.inputs[ports.BAR_MOMENT_REAR] == pytest.approx(-2000)
    assert rig.delivered == pytest.approx([500, -2000])
    assert rig.report["StatusRearLeft"] == rig.report["StatusRearRight"] == 1
    assert rig.report["StatusFrontLeft"] == 0


def test_a_fault_at_either_end_takes_the_whole_bar():
    for corner in ("rear_left", "rear_right"):
        rig = Rig("bars", faults=(ScheduledFault(where=corner, kind="floating"),))
        rig.send("AntiRollBarCommand", TorqueFront=500, TorqueRear=500)
        rig.run(150)
        assert rig.delivered == pytest.approx([500, 0])
        assert rig.report["StatusRearLeft"] == rig.report["StatusRearRight"] == 3


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("kind", ["bars", "valves"])
def test_the_worst_of_several_faults_counts(kind, order):
    faults = (
        ScheduledFault(where="front_left", kind="weak", value=0.5),
        ScheduledFault(where="front_right", kind="floating"),
    )
    rig = Rig(kind, faults=faults[::order])
    rig.send("AntiRollBarCommand", TorqueFront=500, TorqueRear=500)
    rig.run(150)
    assert rig.delivered == pytest.approx([0, 500], abs=10)
    assert rig.report["StatusFrontLeft"] == actuator_kernel.STATUS_FLOATING


def test_dampers_only_take_energy_whatever_is_commanded():
    rng = np.random.default_rng(1)
    for message in ("DamperCommand", "SuspensionForceCommand"):
        rig = Rig("dampers")
        names = [s.name for s in dbc.load().get_message_by_name(message).signals][2:6]
        for _ in range(40):
            values = rng.uniform(0 if message == "DamperCommand" else -4000, 2000, 4)
            rig.send(message, **dict(zip(names, values, strict=True)))

            def stroke(r):
                r.outputs[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4] = rng.normal(0, 0.5, 4)
                r.before = r.outputs[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4].copy()

            for _ in range(10):
                rig.run(1, stroke)
                assert (rig.forces * rig.before <= 0).all()
        assert abs(rig.forces).max() > 0


def test_damper_force_is_that_of_the_map_with_its_lag():
    data = VEHICLE.actuators.dampers
    rig = Rig("dampers", timeout_ms=1e6)
    rig.outputs[ports.TRAVEL_RATE] = 0.3
    current = data.current_limit * 1000
    rig.send("DamperCommand", CurrentFrontLeft=current)
    rig.run(100)
    firm, soft = (np.interp(0.3, data.rate, f) for f in (data.firm_force, data.soft_force))
    share = 1 - (math.exp(-0.099 / data.lag) + math.exp(-0.1 / data.lag)) / 2
    assert rig.forces[0] == pytest.approx(-share * (firm - soft), rel=1e-6)
    rig.run(2000)
    assert rig.forces[0] == pytest.approx(-(firm - soft), rel=1e-6)
    rig.outputs[ports.TRAVEL_RATE] = 2 * data.rate[-1]
    rig.run(1)
    top = data.firm_force[-1] - data.soft_force[-1]
    slope = (top - (data.firm_force[-2] - data.soft_force[-2])) / (data.rate[-1] - data.rate[-2])
    assert rig.forces[0] == pytest.approx(-(top + slope * data.rate[-1]), rel=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("left", "right"), [(0.2, 0.2), (-0.2, 0.2), (0.2, -0.2), (-0.2, -0.2)])
def test_the_four_conditions_of_the_semi_active_rule(sign, left, right):
    """Yim 2020 (25) to (28): a side works only while the moment wanted opposes its stroke."""
    rig = Rig("dampers", timeout_ms=1e6)
    rig.outputs[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4] = [left, right, left, right]
    rig.send("SuspensionForceCommand", **moment(sign * 600))
    rig.run(2000)
    wanted = [sign * 600, -sign * 600] * 2
    expected = [f if f * v < 0 else 0.0 for f, v in zip(wanted, [left, right] * 2, strict=True)]
    assert rig.forces == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_hydraulics_equal_an_independent_integration():
    data = VEHICLE.actuators.valves
    p = hydraulics.parameters(data, thickening=1.0)

    def derivative(t, x, current, roll):
        xv, dxv, dp, angle, speed = x
        w = data.valve_frequency
        flow = data.flow_gain * xv - data.pressure_coefficient * dp
        leak = (data.displacement - data.leakage_by_rotation) * speed + data.leakage * dp
        twist = data.bar_stiffness * (data.lever_ratio * roll(t) + angle)
        return [
            dxv,
            w**2 * (data.valve_gain * current - xv) - 2 * data.valve_damping * w * dxv,
            4 * data.bulk_modulus / data.volume * (flow - leak),
            speed,
            (data.displacement * dp - data.motor_damping * speed - twist) / data.motor_inertia,
        ]

    def roll(t):
        return 0.03 * t

    solution = integrate.solve_ivp(
        derivative, (0, 0.2), np.zeros(5), args=(2.0, roll), rtol=1e-10, atol=1e-14, method="LSODA"
    )
    motor = np.zeros(5)
    for k in range(200):
        hydraulics.advance(motor, p, 2.0, roll(k * 1e-3), 0.03)
    np.testing.assert_allclose(motor, solution.y[:, -1], rtol=1e-3, atol=1e-12)


def test_a_moment_demand_closes_the_torque_loop_and_rejects_the_bodys_roll():
    rig = Rig("valves", timeout_ms=1e6)
    rig.send("AntiRollBarCommand", TorqueFront=800, TorqueRear=-400)

    def sway(r):
        t = r.t * 1e-9
        track = VEHICLE.geometry.half_track_front
        angle, speed = 0.02 * math.sin(3 * t), 0.06 * math.cos(3 * t)
        for wheel, side in enumerate((1, -1, 1, -1)):
            r.outputs[ports.TRAVEL + wheel] = side * track * angle
            r.outputs[ports.TRAVEL_RATE + wheel] = side * track * speed

    trace = rig.run(1500, sway)
    assert trace[300:, 0] == pytest.approx(np.full(1200, 800), abs=40)
    assert trace[300:, 1] == pytest.approx(np.full(1200, -400), abs=40)


def test_valve_current_is_flow_so_the_moment_keeps_growing_until_a_stop():
    rig = Rig("valves", timeout_ms=1e6)
    rig.send("ValveCommand", CurrentFront=-500)
    trace = rig.run(400)[:, 0]
    assert trace[399] - trace[300] == pytest.approx(trace[300] - trace[201], rel=0.1)
    assert trace[399] > trace[200] > 0
    rig = Rig("valves", timeout_ms=1e6)
    rig.send("ValveCommand", CurrentFront=-9000)
    rig.run(2000)
    assert rig.report["StatusFrontLeft"] == actuator_kernel.STATUS_LIMITED
    assert abs(rig.node["motor"][0, hydraulics.ANGLE]) <= (VEHICLE.actuators.valves.angle_limit)


def test_the_motor_rests_at_its_stop_and_leaves_it_again():
    data = VEHICLE.actuators.valves
    p = hydraulics.parameters(data, thickening=1.0)
    motor = np.zeros(5)
    bound = False
    for _ in range(3000):
        bound = hydraulics.advance(motor, p, 8.0, 0.0, 0.0)
    assert bound
    assert motor[hydraulics.ANGLE] == data.angle_limit
    assert motor[hydraulics.ANGLE_RATE] == 0
    for _ in range(300):
        hydraulics.advance(motor, p, -8.0, 0.0, 0.0)
    assert motor[hydraulics.ANGLE] < 0.9 * data.angle_limit


def test_pressure_ends_at_the_supply():
    data = dataclasses.replace(VEHICLE.actuators.valves, supply_pressure=2e5)
    p = hydraulics.parameters(data, thickening=1.0)
    motor = np.zeros(5)
    highest = 0.0
    for _ in range(500):
        hydraulics.advance(motor, p, 5.0, 0.0, 0.0)
        highest = max(highest, motor[hydraulics.PRESSURE])
    assert highest == 2e5


def test_without_a_command_an_electro_hydraulic_bar_is_a_plain_one():
    rig = Rig("valves", timeout_ms=50.0)
    rig.send("AntiRollBarCommand", TorqueFront=800)
    rig.run(50)
    assert rig.delivered[0] > 200
    fades = round(1e3 * VEHICLE.plant.roll_period)
    before = rig.delivered[0]
    rig.run(fades // 2)
    assert rig.delivered[0] == pytest.approx(0.5 * before, rel=0.1)
    rig.run(fades)
    assert abs(rig.delivered[0]) < 20


@pytest.mark.parametrize(
    ("kind", "status", "low", "high"),
    [("stuck", 2, 560, 600), ("floating", 3, 0, 0), ("weak", 1, 560, 600)],
)
def test_faults_of_an_electro_hydraulic_bar(kind, status, low, high):
    weak = ScheduledFault(where="front_right", kind=kind, start=0.5, value=0.4)
    rig = Rig("valves", faults=(weak,), timeout_ms=1e6)
    rig.send("AntiRollBarCommand", TorqueFront=600, TorqueRear=600)
    rig.run(600)
    assert rig.report
    rig.run(50)
    assert low <= rig.delivered[0] <= high
    assert rig.delivered[1] == pytest.approx(600, rel=0.02)
    report = rig.report
    assert (report["StatusFrontLeft"], report["StatusRearLeft"]) == (status, 0)


def fault(corner="rear_left", kind="weak"):
    return {"faults": (ScheduledFault(where=corner, kind=kind, value=0.5),)}


@pytest.mark.parametrize(
    ("kind", "options", "error", "text"),
    [
        ("bar", {}, UnknownNameError, "bars"),
        ("bars", {"estimate_error": 0.3}, CanrollError, "0.2"),
        ("bars", {"timeout_ms": 0.0}, CanrollError, "timeout"),
        ("bars", fault(corner="left"), UnknownNameError, "left"),
        ("bars", fault(kind="slaw"), UnknownNameError, "slow"),
        ("bars", {"faults": fault()["faults"] * 17}, CanrollError, "at most 16"),
    ],
)
def test_impossible_options_are_refused(kind, options, error, text):
    with pytest.raises(error, match=text):
        Rig(kind, **options)


def test_kinds_have_the_numbers_of_the_firmware():
    numbers = {name: getattr(fw, name.upper()) for name in ACTUATORS}
    assert {name: actuator.number for name, actuator in ACTUATORS.items()} == numbers


@pytest.mark.parametrize(("lateral", "outward"), [(6.0, True), (-6.0, False)])
def test_what_fades_is_dropped_where_it_would_push_outward(lateral, outward):
    rig = Rig("suspension", vehicle=roomy())
    rig.send("SuspensionForceCommand", **moment(2000))
    rig.run(161)
    heard = rig.node["envelope"]
    heard["acceleration"], heard["heard_ns"] = lateral, 161e6
    rig.run(100)
    assert (rig.forces[0] < 20) == outward
