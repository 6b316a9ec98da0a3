"""The world as an ECU meets it: frames in time, forces from commands, ages, determinism."""

import dataclasses

import numpy as np
import pytest
from e2e import p01

from canroll import dbc, vehicles
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim import bodies, can_bus
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.nodes.actuators import ActuatorOptions
from canroll.plant_sim.nodes.sensors import SensorOptions
from canroll.plant_sim.world import open_loop
from canroll.plant_sim.world.world import World

VEHICLE = vehicles.load("van_real")
UNSPRUNG_SHARE = 1.0 - VEHICLE.plant.sprung_mass / VEHICLE.total_mass
MS = 1_000_000
TICK = 10 * MS
RUN_TIME = 200_000
MESSAGES = {m.frame_id: m for m in dbc.load().messages}
IDS = {m.name: i for i, m in MESSAGES.items()}


def make(**options):
    profile = can_bus.load_profile(options.pop("bus", "500k"))
    speed = options.pop("speed", None)
    plain = {"vehicle": VEHICLE, "body": "roll1", "actuator": "suspension", "seed": 5}
    maneuver = maneuvers.build("double_lane_change", VEHICLE, speed)
    return World(**{**plain, **options}, maneuver=maneuver, profile=profile)


def protect(name, counter, **values):
    message = dbc.load().get_message_by_name(name)
    data = bytearray(
        message.encode({**{s.name: 0 for s in message.signals}, **values}, strict=False)
    )
    data[1] = data[1] & 0xF0 | counter
    p01.e2e_p01_protect(data, dbc.data_id(message), length=8, increment_counter=False)
    return bytes(data)


def decode(frame):
    return MESSAGES[int(frame["ident"])].decode(
        bytes(frame["payload"][: frame["length"]]), decode_choices=False
    )


def moment(value):
    """Command for a roll moment (N·m) split evenly over four corners of this van."""
    geometry = VEHICLE.geometry
    front, rear = value / (4 * geometry.half_track_front), value / (4 * geometry.half_track_rear)
    names = ("ForceFrontLeft", "ForceFrontRight", "ForceRearLeft", "ForceRearRight")
    return dict(zip(names, (front, -front, rear, -rear), strict=True))


def drive(world, law=None, *, tick=TICK, until=None):
    """Run an ECU that feeds the last IMU sample to ``law``; the frames it received."""
    received, t, counter, last = [], 0, 0, None
    while t < (until or world.duration_ns):
        t += tick
        for frame in world.advance(t):
            received.append(frame)
            if frame["ident"] == IDS["Imu"]:
                last = decode(frame)
        if law and last:
            payload = protect("SuspensionForceCommand", counter, **moment(law(last)))
            world.submit(t + RUN_TIME, IDS["SuspensionForceCommand"], payload)
            counter = (counter + 1) % 15
    return received


def counteract(imu):
    return -300.0 * imu["LateralAcceleration"] - 60.0 * imu["RollRate"]


def test_every_frame_at_the_ecu_is_decodable_protected_in_time_and_complete():
    world = make()
    received = drive(world)
    times = [int(f["t_ns"]) for f in received]
    assert times == sorted(times)
    for frame in received:
        message = MESSAGES[int(frame["ident"])]
        data = bytearray(frame["payload"])
        assert p01.e2e_p01_check(data, dbc.data_id(message), length=8)
    for name, period in [("Imu", 10), ("VehicleMotion", 20), ("RollReference", 10)]:
        own = [f for f in received if f["ident"] == IDS[name]]
        assert abs(len(own) - world.duration_ns / (period * MS)) <= 2
        counters = np.array([decode(f)["Counter"] for f in own])
        assert ((np.diff(counters) % 15) == 1).all()
    assert {int(f["ident"]) for f in received} == {
        IDS[n]
        for n in (
            "Imu",
            "VehicleMotion",
            "SuspensionRate",
            "SuspensionTravel",
            "ActuatorState",
            "RollReference",
        )
    }


def test_frames_are_returned_exactly_once_in_the_window_asked_for():
    world, edge, frames = make(), 0, []
    for until in (3 * MS, 3 * MS, 7_345_678, 41 * MS, 41 * MS + 1, 300 * MS):
        got = world.advance(until)
        assert all(edge < f["t_ns"] <= until for f in got)
        edge = until
        frames += [bytes(f) for f in got]
    again = make()
    assert frames == [bytes(f) for f in again.advance(300 * MS)]


def test_uncontrolled_the_body_moves_as_it_does_alone():
    world = make(enabled=False)
    drive(world, counteract)
    passive, steer = open_loop.run_passive(
        VEHICLE, bodies.body("roll1"), maneuvers.build("double_lane_change", VEHICLE)
    )
    signals = world.signals
    count = min(len(passive), len(signals["time"]))
    from canroll.plant_sim.bodies import ports

    np.testing.assert_array_equal(signals["roll"][:count], passive[:count, ports.ROLL])
    np.testing.assert_array_equal(signals["steer"][:count], steer[:count])
    assert not any(signals[f"corner_force_{w}"].any() for w in ("front_left", "rear_right"))
    state = [f for f in drive(make(enabled=False)) if f["ident"] == IDS["ActuatorState"]]
    assert all(decode(f)["Enabled"] == 0 for f in state)


def test_feedback_over_the_bus_holds_the_body():
    free, held = make(enabled=False), make()
    drive(free, counteract)
    drive(held, counteract)
    rms = [np.sqrt(np.mean(w.signals["roll"] ** 2)) for w in (free, held)]
    assert rms[1] < 0.8 * rms[0]
    signals = held.signals
    total = signals["moment_front"] + signals["moment_rear"]
    assert np.corrcoef(total, signals["ay"])[0, 1] < -0.9


def test_the_reference_frame_is_the_recorded_truth():
    world = make(sensors=SensorOptions(phases={"RollReference": 0.003}))
    received = drive(world)
    signals = world.signals
    checked = 0
    for index, frame in enumerate(f for f in received if f["ident"] == IDS["RollReference"]):
        values = decode(frame)
        row = 3 + 10 * index - 1
        assert values["RollAngle"] == pytest.approx(np.degrees(signals["roll"][row]), abs=0.0011)
        assert values["RollRate"] == pytest.approx(np.degrees(signals["roll_rate"][row]), abs=0.003)
        assert values["LateralAcceleration"] == pytest.approx(signals["ay"][row], abs=0.0007)
        checked += 1
    assert checked > 100


def test_the_steering_wheel_is_that_of_the_driver_through_the_ratio():
    received = drive(world := make(sensors=SensorOptions.ideal(synchronous=True)))
    frames = [f for f in received if f["ident"] == IDS["VehicleMotion"]][1:]
    steer = world.signals["steer"][19::20][: len(frames)]
    sent = [decode(f)["SteeringWheelAngle"] for f in frames[: len(steer)]]
    assert sent == pytest.approx(np.degrees(steer) * VEHICLE.steering.ratio, abs=0.06)


@pytest.mark.parametrize("bus", ["500k", "gateway_50ms", "125k_busy"])
def test_ages_are_those_of_the_log(bus):
    """From the log alone: the Imu frames in the ECU's hands at the tick, the command's arrival."""
    world = make(bus=bus, seed=11)
    drive(world, counteract)
    log = world.frames
    ecu = 0
    plant_segment = int(log["segment"].max())
    delivered = log[log["outcome"] == can_bus.DELIVERED]
    imu = delivered[(delivered["ident"] == IDS["Imu"]) & (delivered["segment"] == ecu)]
    commands = delivered[
        (delivered["ident"] == IDS["SuspensionForceCommand"])
        & (delivered["segment"] == plant_segment)
    ]
    latency = round(VEHICLE.sensors.roll_rate.latency * 1e9)
    expected = []
    for command in commands:
        applied = -(-int(command["t_received"]) // MS) * MS
        tick = int(command["t_origin"]) - RUN_TIME
        newest = imu[imu["t_received"] <= tick]["t_origin"].max()
        if applied < world.now_ns:
            expected.append(applied - (int(newest) - latency))
    assert len(expected) > 50
    np.testing.assert_array_equal(world.ages, expected)
    if bus == "gateway_50ms":
        assert world.ages.min() > 100 * MS
    else:
        assert world.ages.max() < 60 * MS


@pytest.mark.parametrize("bus", [name for name in BUSES if can_bus.load_profile(name).dbc is None])
def test_ages_lie_within_the_bounds_of_the_analysis(bus):
    bounds = delay_bounds(
        can_bus.load_profile(bus),
        tick_ms=TICK / MS,
        command="SuspensionForceCommand",
        run_time_s=RUN_TIME * 1e-9,
    )
    latency = VEHICLE.sensors.roll_rate.latency
    for seed in range(3):
        world = make(bus=bus, seed=seed)
        drive(world, counteract)
        assert world.ages.min() * 1e-9 >= bounds.age_min + latency
        assert world.ages.max() * 1e-9 <= bounds.age_max + latency


def test_a_silent_ecu_is_let_go_after_the_timeout():
    world = make(command_timeout_ms=160.0)
    world.advance(TICK)
    world.submit(
        TICK, IDS["SuspensionForceCommand"], protect("SuspensionForceCommand", 0, **moment(2000))
    )
    # it fades over a period of the roll
    faded = 160 + round(1e3 * VEHICLE.design.roll_period)
    world.advance((faded + 200) * MS)
    signals = world.signals
    total = signals["moment_front"] + signals["moment_rear"]
    assert total[150] == pytest.approx(2000, rel=0.01)
    assert abs(total[-1]) < 1
    held = np.flatnonzero(signals["command_held"])
    assert 160 <= len(held) <= 161


def test_the_ecu_reads_its_acknowledgement_and_the_delivered_moment():
    world = make(actuators=ActuatorOptions(estimate_error=0.1))
    before = world.advance(5 * TICK)
    payload = protect("SuspensionForceCommand", 9, Mode=9, **moment(1500))
    world.submit(5 * TICK, IDS["SuspensionForceCommand"], payload)
    after = world.advance(15 * TICK)
    states = [[f for f in part if f["ident"] == IDS["ActuatorState"]] for part in (before, after)]
    assert {decode(f)["AcceptedCounter"] for f in states[0]} == {15}
    values = [decode(f) for f in states[1]]
    assert values[-1]["AcceptedCounter"] == 9
    total = values[-1]["DeliveredMomentFront"] + values[-1]["DeliveredMomentRear"]
    assert total == pytest.approx(1650, rel=0.01)


def test_frames_of_other_senders_and_damaged_commands_do_not_move_the_car():
    world = make()
    world.advance(TICK)
    good = protect("SuspensionForceCommand", 0, **moment(2000))
    world.submit(TICK, IDS["SuspensionForceCommand"], bytes([good[0] ^ 1]) + good[1:])
    world.submit(TICK, IDS["AntiRollBarCommand"], protect("AntiRollBarCommand", 0, TorqueFront=900))
    world.advance(200 * MS)
    assert len(world.commands) == 0
    assert not world.signals["moment_front"].any()


def test_same_seed_same_bytes_and_another_seed_other_bytes():
    runs = []
    for seed in (7, 7, 8):
        world = make(seed=seed)
        drive(world, counteract, until=800 * MS)
        runs.append((world.frames.tobytes(), world.signals["roll"].tobytes()))
    assert runs[0] == runs[1]
    assert runs[0][0] != runs[2][0]


def test_one_long_advance_equals_many_short_ones():
    one, many = make(), make()
    one.advance(1500 * MS)
    for t in range(0, 1500 * MS + 1, MS // 2):
        many.advance(t)
    assert one.frames.tobytes() == many.frames.tobytes()
    np.testing.assert_array_equal(one.signals["roll"], many.signals["roll"])


def test_the_run_goes_on_beyond_the_manoeuvre_and_records_every_millisecond():
    world = make()
    world.advance(world.duration_ns + 1000 * MS)
    signals = world.signals
    assert len(signals["time"]) == world.duration_ns // MS + 1000
    np.testing.assert_allclose(np.diff(signals["time"]), 1e-3, atol=1e-9)
    assert world.finished


@pytest.mark.parametrize(
    ("actuator", "name", "share"),
    [
        ("bars", "AntiRollBarCommand", 0.8),
        ("valves", "AntiRollBarCommand", 0.8),
        ("dampers", "SuspensionForceCommand", 0.99),
    ],
)
def test_the_other_actuators_reduce_roll_over_the_bus(actuator, name, share):
    rolls = []
    for enabled in (False, True):
        world = make(actuator=actuator, command=name, enabled=enabled)
        t = counter = 0
        value = 0.0
        while t < world.duration_ns:
            t += TICK
            for frame in world.advance(t):
                if frame["ident"] == IDS["Imu"]:
                    value = counteract(decode(frame))
            halves = {"TorqueFront": value / 2, "TorqueRear": value / 2}
            values = moment(value) if actuator == "dampers" else halves
            world.submit(t + RUN_TIME, IDS[name], protect(name, counter, **values))
            counter = (counter + 1) % 15
        rolls.append(np.sqrt(np.mean(world.signals["roll"] ** 2)))
    assert rolls[1] < share * rolls[0]


def test_a_rolled_over_vehicle_stays_where_it_is():
    tall = dataclasses.replace(
        VEHICLE, plant=dataclasses.replace(VEHICLE.plant, roll_stiffness=8000.0)
    )
    world = World(
        vehicle=tall,
        body="roll1",
        actuator="suspension",
        maneuver=maneuvers.build("double_lane_change", tall),
        profile=can_bus.load_profile("500k"),
    )
    t = 0
    while not world.finished:
        t += TICK
        world.advance(t)
    assert world.rolled_over
    assert t < world.duration_ns
    world.advance(t + 500 * MS)
    assert np.ptp(world.signals["roll"][-500:]) == 0


def test_misuse_is_refused_in_one_line():
    world = make()
    world.advance(50 * MS)
    with pytest.raises(CanrollError, match="past"):
        world.submit(49 * MS, 0x80, b"\0" * 8)
    for ident, payload in [(0x800, b""), (0x80, b"\0" * 9)]:
        with pytest.raises(CanrollError, match="11 bits"):
            world.submit(50 * MS, ident, payload)
    for _ in range(256):
        world.submit(50 * MS, 0x300, b"\0" * 8)
    with pytest.raises(CanrollError, match="256"):
        world.submit(50 * MS, 0x300, b"\0" * 8)
    with pytest.raises(CanrollError, match="back"):
        world.advance(49 * MS)
    with pytest.raises(UnknownNameError, match="roll1"):
        make(body="rol1")
    with pytest.raises(UnknownNameError, match="bars"):
        make(actuator="bar")
    with pytest.raises(UnknownNameError, match="SuspensionForceCommand"):
        make(command="AntiRollBarCommand")


def straight(world, force, until):
    """Hold one force at each corner for a while and give the mean wheel loads of the last 0.2 s."""
    names = ("ForceFrontLeft", "ForceFrontRight", "ForceRearLeft", "ForceRearRight")
    for counter, t in enumerate(range(TICK, until, 5 * TICK)):
        world.advance(t)
        payload = protect(
            "SuspensionForceCommand", counter % 15, **dict(zip(names, force, strict=True))
        )
        world.submit(t, IDS["SuspensionForceCommand"], payload)
    world.advance(until)
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    return np.array([world.signals[f"wheel_load_{w}"][-200:].mean() for w in wheels])


@pytest.mark.parametrize("body", ["linear_car", "nonlinear"])
def test_actuators_push_body_and_wheels_apart(body):
    """Forces between body and wheels are internal: they lift the body, not the car."""

    def loads(force):
        world = World(
            vehicle=VEHICLE,
            body=body,
            actuator="suspension",
            maneuver=maneuvers.build("double_lane_change", VEHICLE, 10.0),
            profile=can_bus.load_profile("500k"),
            sensors=SensorOptions.ideal(),
        )
        result = straight(world, force, 1400 * MS)
        return result, world.signals["heave"][-1], world.signals["roll"][-1]

    rest, height, _ = loads((0, 0, 0, 0))
    lifted, higher, _ = loads((1000, 1000, 1000, 1000))
    assert higher > height + 0.005
    assert lifted.sum() == pytest.approx(rest.sum(), rel=2e-3)
    rolled, _, roll = loads((1000, -1000, 1000, -1000))
    assert roll > 0.01
    # Body and wheels together: only the shifted weight, not the moment itself, reaches the road.
    shift = (rolled[0] + rolled[2]) - (rest[0] + rest[2])
    assert abs(shift) < 300


@pytest.mark.parametrize(
    ("body", "behind"),
    [("roll1", 1.0), ("linear_car", UNSPRUNG_SHARE), ("nonlinear", UNSPRUNG_SHARE)],
)
def test_the_imu_feels_what_its_place_on_the_body_does(body, behind):
    """Lateral frames against the recorded motion by the linear relation for small angles.

    When the body rolls its CG moves sideways beside the car's, which lies at the roll axis on
    roll1.
    """
    world = make(body=body, sensors=SensorOptions.ideal(phases={"Imu": 0.004}))
    frames = [f for f in drive(world) if f["ident"] == IDS["Imu"]]
    s = world.signals
    rows = 3 + 10 * np.arange(len(frames))
    x, y, z = VEHICLE.sensors.imu_position
    arm = behind * VEHICLE.plant.cg_height_above_roll_axis
    sideways = s["ay"] - arm * s["roll_acc"] + VEHICLE.sprung_cg_offset * s["yaw_acc"]
    expected = (
        sideways * np.cos(s["roll"])
        + (9.81 + s["heave_acc"]) * np.sin(s["roll"])
        + s["yaw_acc"] * x
        - s["roll_acc"] * z
        - (s["yaw_rate"] ** 2) * y
    )[rows]
    sent = np.array([decode(f)["LateralAcceleration"] for f in frames])
    assert sent == pytest.approx(expected, abs=0.12)
    assert np.sqrt(np.mean((sent - expected) ** 2)) < 0.05
    gyro = np.array([decode(f)["RollRate"] for f in frames])
    rate = s["roll_rate"] - s["yaw_rate"] * np.sin(s["pitch"])
    askew = VEHICLE.sensors.imu_misalignment
    slip = max(askew) * np.degrees(np.abs(s["yaw_rate"]).max() + np.abs(s["pitch_rate"]).max())
    assert gyro == pytest.approx(np.degrees(rate[rows]), abs=0.01 + 2 * slip)
