"""Faults of nodes, bus and frames, and attackers, as an ECU on the bus meets them."""

import numpy as np
import pytest
from e2e import p01

from canroll import dbc, vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import can_bus
from canroll.plant_sim.can_bus.kernel.layout import ERROR
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.faults import parse
from canroll.plant_sim.world.world import World

VEHICLE = vehicles.load("van_real")
MS = 1_000_000
MESSAGES = {m.name: m for m in dbc.load().messages}
COMMAND = "AntiRollBarCommand"


def make(fault="", bus="500k"):
    return World(
        vehicle=VEHICLE,
        body="roll1",
        actuator="bars",
        maneuver=maneuvers.build("double_lane_change", VEHICLE, None),
        profile=can_bus.load_profile(bus),
        seed=5,
        faults=parse(fault) if fault else (),
    )


def command(counter):
    message = MESSAGES[COMMAND]
    values = {s.name: 0 for s in message.signals} | {"TorqueFront": 500, "TorqueRear": 500}
    data = bytearray(message.encode(values, strict=False))
    data[1] = data[1] & 0xF0 | counter
    p01.e2e_p01_protect(data, dbc.data_id(message), length=8, increment_counter=False)
    return bytes(data)


def drive(world, until_ms=1000):
    """Run an ECU that sends a command every 10 ms; return the frames it received."""
    received = []
    for number in range(until_ms // 10):
        received += list(world.advance(number * 10 * MS))
        world.submit(world.now_ns, MESSAGES[COMMAND].frame_id, command(number % 15))
    return received


def of(frames, name, start_ms=0, end_ms=1 << 40):
    """Frames of a message received from ``start_ms`` on and before ``end_ms``."""
    return [
        frame
        for frame in frames
        if frame["ident"] == MESSAGES[name].frame_id
        and start_ms * MS <= frame["t_ns"] < end_ms * MS
    ]


def decoded(frame):
    return MESSAGES[_name(frame)].decode(bytes(frame["payload"][:8]), decode_choices=False)


def _name(frame):
    return next(name for name, m in MESSAGES.items() if m.frame_id == frame["ident"])


def intact(frame):
    message = MESSAGES[_name(frame)]
    return p01.e2e_p01_check(bytearray(frame["payload"][:8]), dbc.data_id(message), length=8)


def applied(world, start_ms, end_ms):
    times = world.commands["t_applied"]
    return int(np.sum((times >= start_ms * MS) & (times < end_ms * MS)))


def test_a_node_that_is_down_is_not_heard_and_starts_anew():
    received = drive(make("node.Imu=down@0.4:0.6"))
    assert not of(received, "Imu", 412, 600)
    assert len(of(received, "VehicleMotion", 412, 600)) > 5
    assert decoded(of(received, "Imu", 600)[0])["SampleCounter"] == 0


def test_a_reset_lasts_its_time_and_a_late_node_comes_late():
    times = [f["t_ns"] for f in of(drive(make("node.Imu=reset:0.1@0.4")), "Imu")]
    assert 100 * MS < np.diff(times).max() < 121 * MS
    late = [f["t_ns"] for f in of(drive(make("node.Imu=late:0.3")), "Imu")]
    assert 300 * MS <= late[0] < 320 * MS


@pytest.mark.parametrize("fault", ["node.Actuator=down@0.4:0.6", "node.Actuator=bus_off@0.4:0.6"])
def test_an_actuator_that_is_down_or_bus_off_does_not_hear(fault):
    world = make(fault)
    received = drive(world)
    assert applied(world, 200, 400) == 20
    # how often it is back in between depends on the bus: 128 times 11 bits after 32 errors
    assert applied(world, 450, 600) <= (0 if "down" in fault else 12)
    assert applied(world, 650, 850) == 20
    assert len(of(received, "ActuatorState", 412, 600)) == 0


def test_an_ecu_that_is_down_or_bus_off_does_not_hear():
    assert not of(drive(make("node.RollControl=down@0.4:0.6")), "Imu", 401, 600)
    world = make("node.RollControl=bus_off@0.4:0.6")
    received = drive(world)
    node = world.network.nodes[can_bus.ECU]
    assert node["bus_offs"] > 0
    assert len(of(received, "Imu", 400, 600)) < 20
    frames = world.frames
    for frame in of(received, "Imu", 400, 600):
        entry = frames[frames["t_received"] == frame["t_ns"]][0]
        assert not node["off_ns"] <= entry["t_received"] < node["on_ns"]


def test_a_silent_node_still_hears():
    world = make("node.Actuator=silent@0.4:0.6")
    received = drive(world)
    assert not of(received, "ActuatorState", 412, 600)
    assert applied(world, 400, 600) == 20


@pytest.mark.parametrize("fault", ["node.Chassis=babbling@0.4:0.6", "bus=flood@0.4:0.6"])
def test_a_flood_takes_its_share_of_the_bus(fault):
    world = make(fault, bus="500k")
    drive(world)
    frames = world.frames
    flood = frames[(frames["ident"] == 0) & (frames["t_start"] >= 0)]
    taken = np.sum(flood["t_end"] - flood["t_start"]) / (200 * MS)
    assert 0.8 < taken <= 1.0
    assert (flood["t_end"] < 605 * MS).all()


def test_a_slow_clock_sends_less_often():
    frames = of(drive(make("node.Imu=clock_drift:0.25@0.4")), "Imu")
    steps = np.diff([f["t_ns"] for f in frames if f["t_ns"] > 420 * MS])
    assert np.mean(steps) == pytest.approx(12.5 * MS, rel=0.01)


def test_lost_frames_are_on_the_bus_but_not_received():
    world = make("Imu=loss:1@0.4:0.6")
    assert not of(drive(world), "Imu", 400, 600)
    frames = world.frames
    ours = frames[frames["ident"] == MESSAGES["Imu"].frame_id]
    assert np.sum((ours["t_received"] > 400 * MS) & (ours["t_received"] < 600 * MS)) >= 19


def test_lost_commands_are_not_applied():
    world = make(f"{COMMAND}=loss:0.5@0.2")
    drive(world)
    assert 20 < applied(world, 200, 1000) < 70


def test_a_damaged_frame_has_one_wrong_bit_for_its_receiver_alone():
    world = make("Imu=corruption:1@0.4:0.6")
    received = drive(world)
    assert all(intact(frame) for frame in of(received, "Imu", 0, 400))
    damaged = of(received, "Imu", 400, 600)
    assert len(damaged) >= 19
    frames = world.frames
    for frame in damaged:
        entry = frames[frames["t_received"] == frame["t_ns"]][0]
        assert np.unpackbits(entry["payload"] ^ frame["payload"]).sum() == 1


def test_delayed_duplicated_and_overtaken_frames():
    late = of(drive(make("Imu=delay:0.02")), "Imu")
    plain = of(drive(make()), "Imu")
    assert late[0]["t_ns"] - plain[0]["t_ns"] == pytest.approx(20 * MS, abs=1 * MS)
    assert len(of(drive(make("Imu=duplicate:1")), "Imu")) >= 2 * len(plain) - 2
    counters = [decoded(f)["Counter"] for f in of(drive(make("Imu=reorder:0.3")), "Imu")]
    assert np.any(np.diff(counters) % 15 > 7)


def test_bit_errors_come_and_go():
    world = make("bus=error_rate:1e-3@0.4:0.6")
    drive(world)
    frames = world.frames
    wrong = frames[frames["outcome"] == ERROR]["t_start"]
    assert len(wrong) > 10
    assert wrong.min() >= 400 * MS and wrong.max() < 600 * MS


def test_a_partition_needs_gateways():
    world = make("bus=partition@0.4:0.6", bus="gateway_20ms")
    received = drive(world)
    assert not of(received, "Imu", 450, 600)
    assert len(of(received, "Imu", 700)) > 20
    with pytest.raises(CanrollError, match="no gateway"):
        make("bus=partition")


def test_a_spoofed_signal_looks_genuine():
    received = of(drive(make("attacker.Imu.RollRate=spoof:0.5@0.4")), "Imu", 450)
    assert all(intact(frame) for frame in received)
    seen = [decoded(frame) for frame in received]
    false = [values for values in seen if abs(values["RollRate"] - 28.65) < 0.01]
    assert len(false) == pytest.approx(len(seen) / 2, abs=1)
    first = seen.index(false[0])
    genuine, answer, following = seen[first - 1 : first + 2]
    assert answer["Counter"] == following["Counter"] == (genuine["Counter"] + 1) % 15
    assert answer["SampleCounter"] == (genuine["SampleCounter"] + 1) % 16


def test_a_spoofed_command_is_applied():
    world = make(f"attacker.{COMMAND}.TorqueFront=spoof:-1500@0.4")
    drive(world)
    assert world.signals["demand_front_left"][600] == pytest.approx(-1500, abs=4)
    assert world.signals["demand_front_right"][600] == pytest.approx(500, abs=4)


def test_replayed_and_short_frames():
    plain = of(drive(make()), "Imu")
    assert len(of(drive(make("attacker.Imu=replay:0.1@0.4")), "Imu")) > 1.4 * len(plain)
    world = make("attacker.Imu=wrong_length:4@0.4")
    received = of(drive(world), "Imu", 420)
    frames = world.frames[world.frames["t_received"] > 420 * MS]
    short = frames[(frames["ident"] == MESSAGES["Imu"].frame_id) & (frames["length"] == 4)]
    assert len(short) == pytest.approx(len(received), abs=1)
    assert all(frame["length"] == 8 for frame in received)


def test_the_same_seed_gives_the_same_faults():
    fault = "Imu=loss:0.3@0.1 + bus=corruption:0.1 + Imu=reorder:0.2 + bus=flood:0.5@0.3"
    one, two = make(fault), make(fault)
    assert [f.tobytes() for f in drive(one)] == [f.tobytes() for f in drive(two)]
    assert one.frames.tobytes() == two.frames.tobytes()


def test_impossible_faults_of_frames_are_refused():
    with pytest.raises(CanrollError, match="give fewer"):
        make("attacker.Imu=wrong_length:12")
    with pytest.raises(CanrollError, match="at most 16"):
        make(" + ".join(["Imu=loss:0.1"] * 17))


@pytest.mark.parametrize(
    ("fault", "later"),
    [
        ("Imu=delay:0.05", 50),
        (f"{COMMAND}=delay:0.03", 30),
        ("Imu=duplicate:1", 0),
        ("Imu=reorder:1", 15),
    ],
)
def test_what_a_frame_is_late_by_is_age_of_its_sample(fault, later):
    plain, late = make(), make(fault)
    drive(plain)
    drive(late)
    least = np.subtract(late.ages, plain.ages[: len(late.ages)])[10:]
    assert len(least) > 80
    assert least.min() >= (later - 10) * MS
    assert least.mean() == pytest.approx(later * MS, abs=5 * MS)
