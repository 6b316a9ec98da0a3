"""A network in a file: what it becomes, what is refused, and ages that keep to its bounds."""

import re
from pathlib import Path

import cantools
import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.buses.topology import NODES, BusGateway, TimeSpread
from canroll.plant_sim.can_bus import ACTUATOR, ECU, IMU, load_profile, make_network
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds
from canroll.plant_sim.can_bus.network.own_frames import own_messages
from canroll.plant_sim.can_bus.network.profiles import profile_spec, routed_messages
from canroll.plant_sim.can_bus.simulation.ages import BusLoop, simulate_ages
from canroll.plant_sim.kernels.instants import MS
from tests.support.background import background_of

ROOT = Path(__file__).parents[4]
OWN = ROOT / "examples" / "own_bus"
NETWORK = """schema = 1

[segment.ecu]
bitrate = 500000
load = 0.4

[segment.backbone]
bitrate = 1000000
data_bitrate = 2000000
load = 0.3
above = 0.9

[segment.vehicle]
bitrate = 250000
traffic = "others.dbc"
bit_error_rate = 1e-8

[[gateway]]
name = "central"
segments = ["backbone", "ecu"]
latency_ms = [1, 2]

[[gateway]]
segments = ["backbone", "vehicle"]
latency_ms = "latencies.csv"
messages = ["Imu", "VehicleMotion", 0xC0, 0xC8, 0xD0, 0x80, 0x81, 0x82, 0x83, "Doors"]

[node.Imu]
segment = "vehicle"
jitter_ms = "imu.csv"
[node.Chassis]
segment = "vehicle"
[node.Suspension]
segment = "vehicle"
jitter_ms = [0.1, 0.4]
[node.Actuator]
segment = "vehicle"
[node.RollControl]
jitter_ms = 0.2
"""
OTHERS = """VERSION ""

BU_: Body Engine

BO_ 1280 Doors: 8 Body

BO_ 1281 Window: 8 Body

BO_ 16 Engine: 8 Engine

BO_ 1282 Events: 8 Body

BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 1280 50;
BA_ "GenMsgCycleTime" BO_ 1281 20;
BA_ "GenMsgCycleTime" BO_ 16 5;
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "net.toml").write_text(NETWORK)
    (tmp_path / "others.dbc").write_text(OTHERS)
    (tmp_path / "latencies.csv").write_text("latency (ms);when\n2.0;1\n2.5;2\n\n6.0;3 # a peak\n")
    (tmp_path / "imu.csv").write_text("0\n0\n0.25\n1.5\n")
    return tmp_path


def test_what_a_file_says(folder):
    profile = load_profile(str(folder / "net.toml"))
    network = profile.network
    assert [s.name for s in network.segments] == ["ecu", "backbone", "vehicle"]
    assert [s.bitrate for s in network.segments] == [500_000, 1_000_000, 250_000]
    assert network.segments[1].data_bitrate == 2_000_000
    assert network.segments[2].bit_error_rate == 1e-8
    assert network.gateways[0] == BusGateway("central", (1, 0), TimeSpread(1 * MS, 2 * MS))
    measured = TimeSpread(2 * MS, 6 * MS, (2 * MS, 2_500_000, 6 * MS))
    assert network.gateways[1].latency == measured and network.gateways[1].name == "gateway2"
    assert [network.place(node) for node in NODES] == [0, 2, 2, 2, 2, 0]
    assert network.jitter["Imu"].samples_ns == (0, 0, 250_000, 1_500_000)
    assert network.jitter["Suspension"] == TimeSpread(100_000, 400_000)
    assert network.jitter["RollControl"] == TimeSpread(0, 200_000)
    ways = {r.message.name: r.segments for r in routed_messages(profile)}
    assert ways["Imu"] == (2, 1, 0) and ways["SuspensionForceCommand"] == (0, 1, 2)
    assert ways["Doors"] == (2, 1) and ways["Window"] == (2,)
    spec = profile_spec(profile)
    assert {node.name: node.jitter.high_ns for node in spec.nodes[:6]} == {
        "RollControl": 200_000,
        "Imu": 1_500_000,
        "Chassis": 0,
        "Suspension": 400_000,
        "Actuator": 0,
        "Reference": 0,
    }
    assert {node.name for node in spec.nodes} >= {"vehicle/Body", "vehicle/Engine"}


def ages(profile, *, seed, tick_ms, seconds=1.0):
    messages = {m.name: m for m in own_messages(profile=profile)}
    loop = BusLoop(
        sensor=messages["Imu"],
        command=messages["SuspensionForceCommand"],
        sensor_node=IMU,
        command_node=ECU,
        actuator_node=ACTUATOR,
        tick_ns=round(tick_ms * MS),
        tick_offset_ns=seed * 1_234_567 % (10 * MS),
    )
    network = make_network(profile, seed=seed)
    return simulate_ages(network, loop, duration_ns=round(seconds * 1e9))


def test_simulated_ages_keep_to_the_bounds_over_two_gateways(folder):
    profile = load_profile(str(folder / "net.toml"))
    bounds = delay_bounds(profile)
    found = np.concatenate([ages(profile, seed=seed, tick_ms=10.0) for seed in range(8)])
    assert len(found) > 400
    assert found.max() * 1e-9 <= bounds.age_max
    assert found.min() * 1e-9 >= bounds.age_min
    # no empty promise
    assert found.max() * 1e-9 > 0.6 * bounds.age_max
    assert bounds.age_min > 2 * (1 + 2) * 1e-3


@pytest.mark.parametrize("seed", range(12))
def test_ages_keep_to_the_bounds_of_any_network(tmp_path, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path / "net.toml"
    path.write_text(random_file(rng, tmp_path))
    profile = load_profile(str(path))
    tick_ms = float(rng.choice([5.0, 10.0]))
    bounds = delay_bounds(profile, tick_ms=tick_ms)
    for phase in range(2):
        found = ages(profile, seed=seed + 100 * phase, tick_ms=tick_ms, seconds=0.6)
        assert len(found) > 20
        assert found.max() * 1e-9 <= bounds.age_max
        assert found.min() * 1e-9 >= bounds.age_min


def random_file(rng, folder):
    """Two to five segments in a tree, ECU and vehicle anywhere, with all kinds of latencies."""
    count = int(rng.integers(2, 6))
    lines = ["schema = 1"]
    for k in range(count):
        rate = int(rng.choice([250_000, 500_000, 1_000_000]))
        load = rng.uniform(0.25, 0.6) + 0.2 * (rate == 250_000)
        lines.append(f"[segment.s{k}]\nbitrate = {rate}\nload = {load:.3f}")
        lines.append(f"above = {rng.uniform(0, 1):.2f}")
    for k in range(1, count):
        low = rng.uniform(0, 4)
        (folder / f"g{k}.csv").write_text("\n".join(f"{t:.3f}" for t in rng.exponential(2, 30)))
        latency = rng.choice([f"{low:.3f}", f"[{low:.3f}, {low + 3:.3f}]", f'"g{k}.csv"'])
        lines.append(f'[[gateway]]\nsegments = ["s{rng.integers(k)}", "s{k}"]')
        lines.append(f"latency_ms = {latency}")
    for node in NODES:
        lines.append(f'[node.{node}]\nsegment = "s{rng.integers(count)}"')
        if rng.random() < 0.6:
            lines.append(f"jitter_ms = {rng.uniform(0, 2):.3f}")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("schema = 1\n", "schema = 1\nbitrate = 500000\n", "put it into a [segment.NAME]"),
        ("schema = 1\n", "schema = 1\ngateway_ms = 2\n", "put it into a [segment.NAME]"),
        ("bitrate = 250000\n", "", "net.toml [segment.vehicle]: 'bitrate' is missing"),
        ("load = 0.4", "loads = 0.4", "did you mean 'load'"),
        ("load = 0.4", "load = 1.4", "load 1.4"),
        ('"others.dbc"', '"other.dbc"', "other.dbc': no such file"),
        ('"others.dbc"', '"others.dbc"\nload = 0.5', "omit load and above"),
        ('["backbone", "ecu"]', '["backbone", "ecus"]', "did you mean 'ecu'"),
        ('["backbone", "ecu"]', '["ecu", "ecu"]', "must be two of them"),
        ("latency_ms = [1, 2]", "", "'latency_ms' is missing"),
        ("latency_ms = [1, 2]", "latency_ms = [2, 1]", "two times in order"),
        ("latency_ms = [1, 2]", "latency_ms = -1", "0 to 1000 ms"),
        ("latency_ms = [1, 2]", "latency_ms = true", "must be a time"),
        ('"latencies.csv"', '"nowhere.csv"', "cannot read"),
        ('"latencies.csv"', '"others.dbc"', "others.dbc:3: 'BU_: Body Engine' is not a time"),
        ('"Doors"]', '"Door"]', "did you mean 'Doors'"),
        ('"Doors"]', "true]", "neither name nor identifier"),
        ('"Doors"]', "0x501, 0x7FF]", "no message of the network has identifier 0x7FF"),
        ("[node.Imu]", "[node.Gyro]", "node"),
        ("jitter_ms = 0.2", "jitter_ms = 2000", "0 to 1000 ms"),
        ('"Imu", "VehicleMotion"', '"VehicleMotion"', "Imu does not get from segment 'vehicle'"),
        ('name = "central"', 'name = "gateway2"', "two gateways have one name"),
    ],
)
def test_a_wrong_network_is_refused_in_one_line(folder, old, new, word):
    assert old in NETWORK
    path = folder / "net.toml"
    path.write_text(NETWORK.replace(old, new, 1))
    with pytest.raises(CanrollError, match=re.escape(word)) as caught:
        routed_messages(load_profile(str(path)))
    assert "\n" not in str(caught.value)


def test_segments_that_are_not_there_are_not_named(tmp_path):
    path = tmp_path / "net.toml"
    path.write_text('schema = 1\nbitrate = 500000\n[node.Imu]\nsegment = "b"\n')
    with pytest.raises(CanrollError, match=re.escape("there is no [segment.b]")):
        load_profile(str(path))


def test_one_bus_may_have_jitter_and_measured_latencies(tmp_path):
    (tmp_path / "measured.txt").write_text("3\n4\n")
    path = tmp_path / "net.toml"
    path.write_text(
        'schema = 1\nbitrate = 500000\ngateway_ms = "measured.txt"\n[node.Imu]\njitter_ms = 1\n'
    )
    network = load_profile(str(path)).network
    assert network.gateways[0].latency.samples_ns == (3 * MS, 4 * MS)
    assert network.jitter["Imu"] == TimeSpread(0, 1 * MS)
    assert network.place("RollControl") == 0 and network.place("Imu") == 1


@pytest.mark.parametrize("suffix", ["dbc", "kcd", "sym"])
def test_a_database_is_a_network(tmp_path, suffix):
    database = cantools.database.load_string(OTHERS, "dbc")
    path = tmp_path / f"bus.{suffix}"
    cantools.database.dump_file(database, path)
    if suffix == "dbc":
        path.write_text(OTHERS)
    profile = load_profile(str(path))
    found = {m.name: (m.ident, m.period_ns) for m in background_of(profile, 0)}
    assert found == {
        "Doors": (0x500, 50 * MS),
        "Window": (0x501, 20 * MS),
        "Engine": (0x10, 5 * MS),
    }
    assert delay_bounds(profile).age_max < 0.02
    names = {node.name for node in profile_spec(profile).nodes}
    assert names >= ({"bus/Body", "bus/Engine"} if suffix == "dbc" else set())


def test_a_traffic_set_is_a_network(tmp_path):
    path = tmp_path / "set.toml"
    path.write_text(
        'bitrate = 250000\n[[message]]\nname = "A"\nid = 0x20\nbytes = 8\nperiod_ms = 5\n'
        'fifo = true\nnode = "N"\n'
    )
    profile = load_profile(str(path))
    assert profile.bitrate == 250_000
    assert [m.name for m in background_of(profile, 0)] == ["A"]
    nodes = {node.name: node for node in profile_spec(profile).nodes}
    assert nodes["bus/N"].policy == "fifo"


def test_an_identifier_of_ours_is_not_another_message(tmp_path):
    path = tmp_path / "bus.dbc"
    path.write_text(OTHERS.replace("BO_ 16 ", "BO_ 160 ").replace("BO_ 16 5", "BO_ 160 5"))
    with pytest.raises(CanrollError, match="Imu and Engine both have identifier 0xA0"):
        routed_messages(load_profile(str(path)))
    # the same messages that our signals are in are ours
    own = load_profile(str(OWN / "own.dbc"), OWN / "own.dbc", OWN / "own.toml")
    assert background_of(own, 0) == []
