"""Every example of docs/file-formats.md goes through the loader that the commands use."""

import re
import tomllib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from canroll import dbc, vehicles
from canroll.codegen.frame.checksum_units import constant
from canroll.codegen.frame.crc_kinds import CRCS
from canroll.codegen.frame.frame_protection import ATTRIBUTES
from canroll.codegen.frame.own_checksum import own_checksum
from canroll.codegen.frame.own_protection import METHODS, OF_A_CHECKSUM
from canroll.codegen.generated import bus_map, mailbox
from canroll.codegen.generated.mailbox_frame import OVERRIDES
from canroll.codegen.generated.mapped_signal import KEYS
from canroll.firmware import plausibility
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.design import design
from canroll.gain_gen.laws.custom import read_matrices
from canroll.gain_gen.models.task import Delay, Task
from canroll.hil import tick_trace
from canroll.hil.budget import Budget, budget_of
from canroll.plant_sim.buses.topology import TimeSpread
from canroll.plant_sim.can_bus.network.network_file import KEYS as KEYS_OF_A_NETWORK
from canroll.plant_sim.can_bus.network.network_file import load_profile
from canroll.plant_sim.can_bus.network.own_frames import bus_map as bus_map_of
from canroll.plant_sim.can_bus.network.profiles import routed_messages
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, FD
from canroll.plant_sim.driving import MANEUVERS, maneuvers
from canroll.testing import COMMON
from canroll.vehicles.load import from_table
from canroll.vehicles.model import SensorChannel, Vehicle
from canroll.vehicles.suspensions.tables import AxleTables

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "file-formats.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```\w+ (\S+)\n(.*?)^```", re.M | re.S)
EXAMPLES = dict(BLOCK.findall(PAGE))
BUS = dict(BLOCK.findall((ROOT / "docs" / "extend.md").read_text(encoding="utf-8")))
CHECKSUMS = ROOT / "examples" / "cars" / "checksums"


@pytest.fixture
def example(tmp_path):
    """Return a function that writes an example of the page and returns its path."""

    def write(name):
        path = tmp_path / name
        path.write_text(EXAMPLES[name], encoding="utf-8")
        return path

    return write


def section(heading):
    return re.search(rf"^##+ {re.escape(heading)}$(.*?)(?=^## |\Z)", PAGE, re.M | re.S)[1]


def first_column(text):
    """Return the code in the first column of the tables of ``text``."""
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    return [key for row in rows for key in re.findall(r"`(.+?)`", row.split(" | ")[0])]


def test_a_part_of_a_vehicle_fits_into_a_whole_one(example):
    part = tomllib.loads(example("part-of-a-vehicle.toml").read_text())
    whole = tomllib.loads(Path(vehicles.__file__).with_name("van_real.toml").read_text())
    merged = {**whole, **part, "sources": {**whole["sources"], **part["sources"]}}
    camper = from_table(merged, name="camper")
    assert camper.title == "Camper"
    assert camper.source("design.sprung_mass") == "weighed"
    assert camper.source("design.roll_inertia") == "data sheet"
    assert camper.speeds == {"double_lane_change": pytest.approx(80 / 3.6)}


def keys_of(kind, prefix=""):
    """Yield the keys of a vehicle file that a dataclass stands for."""
    for field in fields(kind):
        hint = get_type_hints(kind)[field.name]
        hint = next((part for part in get_args(hint) if is_dataclass(part)), hint)
        shown_before = hint is SensorChannel and field.name != "roll_rate"
        if is_dataclass(hint) and not shown_before and hint is not AxleTables:
            yield from keys_of(hint, f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}"


def told_keys(text):
    """Yield the keys of a table whose rows are sections, or keys outside of any."""
    for line in text.splitlines():
        if line.startswith("| `"):
            first, second = line.split(" | ")[:2]
            keys = re.findall(r"`([a-z_]+)`", second)
            for section_name in re.findall(r"`(.+?)`", first):
                yield from [f"{section_name}.{key}" for key in keys] or [section_name]


def test_every_key_of_a_vehicle_is_told():
    left_out = {"name", "file", "speeds", "lane_offset"}
    expected = {key for key in keys_of(Vehicle) if key not in left_out}
    expected = {key for key in expected if not key.startswith("design.")}
    expected |= {"design", "maneuvers.lane_offset", "maneuvers.speed_kmh", "sensors.roll_rate"}
    assert set(told_keys(section("A vehicle").partition("\n### ")[0])) == expected


@pytest.mark.parametrize("name", ["feedback.toml", "compensator.toml"])
def test_gains_make_a_verified_law(example, name):
    path = example(name)
    assert read_matrices(path)
    task = Task(
        vehicle=vehicles.load("van_real"),
        delay=Delay(0.02, 0.02, 0.02),
        tick=0.01,
        matrices=str(path),
    )
    answer = design("custom", task)
    assert not answer.failures
    assert (answer.controller.compensator is not None) == (name == "compensator.toml")


def test_a_traffic_set_is_read_to_the_last_key(example):
    traffic = load_traffic(example("traffic.toml"))
    wheels, radar = traffic.messages
    assert (traffic.bitrate, traffic.data_bitrate) == (500_000, 2_000_000)
    assert (wheels.ident, wheels.length, wheels.sender) == (0x120, 8, "Chassis")
    assert (wheels.period_ns, wheels.jitter_ns, wheels.offset_ns) == (10e6, 1e6, 2.5e6)
    assert radar.flags & EXTENDED and radar.flags & FD and radar.fifo and radar.length == 64


def test_a_network_is_read_to_the_last_key(example):
    path = example("network.toml")
    own = ROOT / "examples" / "own_bus"
    for name in ("own.dbc", "own.toml"):
        (path.parent / name).write_bytes((own / name).read_bytes())
    profile = load_profile(str(path))
    assert (profile.bitrate, profile.data_bitrate, profile.load) == (500_000, 2_000_000, 0.6)
    assert (profile.above, profile.bit_error_rate) == (0.3, 1e-7)
    assert profile.network.gateways[0].latency == TimeSpread(2_000_000, 4_000_000)
    assert profile.network.jitter["Imu"].high_ns == 300_000
    assert [box.slot for box in bus_map_of(profile).frames][:2] == ["imu", "vehicle_motion"]
    several = tomllib.loads(example("segments.toml").read_text())
    keys = (
        tomllib.loads(path.read_text()).keys() | several.keys() | several["segment"]["body"].keys()
    )
    assert keys == KEYS_OF_A_NETWORK.keys()


def test_segments_are_joined_by_gateways(example):
    path = example("segments.toml")
    (path.parent / "measured.csv").write_text("latency\n1.5\n2\n")
    (path.parent / "others.dbc").write_text(
        'VERSION ""\n\nBU_: Body\n\nBO_ 1280 Doors: 8 Body\n\n'
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
        'BA_ "GenMsgCycleTime" BO_ 1280 50;\n'
    )
    profile = load_profile(str(path))
    ways = {found.message.name: found.segments for found in routed_messages(profile)}
    assert ways["Imu"] == (0, 1) and ways["Doors"] == (1, 0)
    assert profile.network.gateways[0].latency.samples_ns == (1_500_000, 2_000_000)
    assert profile.network.jitter["RollControl"] == TimeSpread(100_000, 400_000)


def test_a_map_leads_from_signals_to_fields(tmp_path):
    (tmp_path / "car.dbc").write_text(BUS["car.dbc"], encoding="utf-8")
    (tmp_path / "car.toml").write_text(BUS["car.toml"], encoding="utf-8")
    mapped = bus_map.load(tmp_path / "car.dbc", tmp_path / "car.toml")
    imu = mapped.received[0]
    assert imu.ident == 291
    assert {s.place.text for s in imu.signals} == {"roll_rate", "lateral_acceleration"}
    assert mapped.transmitted[0].ident == 801 and len(mapped.transmitted[0].signals) == 4
    told = section("A map of your bus")
    for slot in (*mailbox.RECEIVED, *mailbox.TRANSMITTED):
        assert f"`{slot}`" in told


def test_a_map_says_what_the_dbc_does_not(example, tmp_path):
    second = ' SG_ LateralInverted : 27|12@0- (0.01,0) [-20|20] "m/s2" Ecu\n'
    text = BUS["car.dbc"].replace("\n\nBO_ 801", f"\n{second}\nBO_ 801")
    (tmp_path / "car.dbc").write_text(text, encoding="utf-8")
    box = bus_map.load(tmp_path / "car.dbc", example("signal-keys.toml")).received[0]
    assert (box.ident, box.fd, box.length) == (mailbox.EXTENDED | 0x18FF0010, True, 12)
    assert box.cycle_ms == 10
    assert all(f"`{key}" in section("A map of your bus") for key in OVERRIDES)
    rate, lateral = box.signals
    assert 2047 in lateral.unavailable
    assert rate.scale < 0 < lateral.scale
    assert lateral.twin.inverted and lateral.twin.tolerance == 2
    assert set(first_column(section("A map of your bus"))) >= set(KEYS)
    assert plausibility.FAULT_DISAGREEMENT == 5


FRAMES = """\
VERSION ""
BU_: Car
BO_ 1 Acceleration: 8 Car
 SG_ Lateral : 0|16@1- (0.01,0) [0|0] "m/s2" Car
 SG_ Rate : 16|16@1- (0.01,0) [0|0] "deg/s" Car
BO_ 2 YawRate: 8 Car
 SG_ Rate : 0|16@1- (0.01,0) [0|0] "deg/s" Car
 SG_ State : 16|2@1+ (1,0) [0|0] "" Car
BO_ 3 WheelSpeeds: 8 Car
 SG_ FrontLeft : 0|15@1+ (0.1,0) [0|0] "" Car
 SG_ FrontLeftOk : 15|1@1+ (1,0) [0|0] "" Car
 SG_ FrontRight : 16|15@1+ (0.1,0) [0|0] "" Car
 SG_ FrontRightOk : 31|1@1+ (1,0) [0|0] "" Car
BO_ 4 Steering: 8 Car
 SG_ Angle : 0|16@1- (0.1,0) [0|0] "deg" Car
"""


def test_a_map_takes_a_message_from_several_frames(example, tmp_path):
    (tmp_path / "car.dbc").write_text(FRAMES, encoding="utf-8")
    mapped = bus_map.load(tmp_path / "car.dbc", example("several-frames.toml"))
    names = [box.name for box in mapped.received if box.name]
    assert names == ["Acceleration", "WheelSpeeds", "YawRate", "Steering"]
    assert mapped.received[5].signals[0].validity.codes == (1, 2)
    for key in ("valid", "radius"):
        assert f"| `{key}` |" in section("A map of your bus")


def test_a_map_protects_a_frame(example, tmp_path):
    (tmp_path / "car.dbc").write_text(BUS["car.dbc"], encoding="utf-8")
    mapped = bus_map.load(tmp_path / "car.dbc", example("protection.toml"))
    own = mapped.received[0].protection
    assert (own.checksum.fold, own.checksum.polynomial) == ("crc", 0x2F)
    assert own.checksum.place.bits == tuple(range(40, 48))
    assert own.checksum.units[-1] == constant(0x42)
    assert (own.counter.place.bits, own.counter.values) == ((36, 37, 38, 39), 15)
    assert mapped.transmitted[0].protection is None
    told = section("A map of your bus")
    for attribute, key in ATTRIBUTES.items():
        assert f"`{attribute}`" in told and f"`{key}`" in told
    for key in (*OF_A_CHECKSUM, *METHODS[:3], *CRCS):
        assert f"`{key}`" in told or f"{key} =" in told, key


def test_checksums_of_cars_have_the_keys_of_a_map():
    """What they give is in tests/codegen/frame/test_checksums_of_cars.py."""
    cars = tomllib.loads((CHECKSUMS / "checksums.toml").read_text(encoding="utf-8"))
    assert all(set(car["checksum"]) <= set(OF_A_CHECKSUM) for car in cars.values())


def test_a_function_gives_a_checksum():
    own = own_checksum("gm.py:gas_regen", CHECKSUMS, "map.toml")
    assert own(bytes.fromhex("c047404801b8bfb5"), 715) == 0x01B8BFB5


def test_a_manoeuvre_from_a_file_steers(example):
    vehicle = vehicles.load("van_real")
    run = maneuvers.build("from_file", vehicle, 80 / 3.6, file=str(example("steps.csv")))
    assert run.duration_ns == 3_000_000_000
    texts = {
        name: {key for key, value in maneuvers.options(name).items() if isinstance(value, str)}
        for name in MANEUVERS
    }
    own = texts["from_file"] - set(COMMON)
    options = section("A manoeuvre").partition("each option by")[2].partition("\nThe manoeuvre")[0]
    assert own == own & set(re.findall(r"`([a-z_]+)`", options))
    assert set().union(*texts.values()) == set(maneuvers.TEXTS)


@pytest.fixture(scope="module")
def lqr(tmp_path_factory):
    """Return a calibration file."""
    task = Task(vehicle=vehicles.load("van_real"), delay=Delay(0.02, 0.02, 0.02), tick=0.01)
    path = tmp_path_factory.mktemp("lqr") / "calibration.toml"
    calibration_file.save(path, *calibrate(design("lqr", task)))
    return path


def test_a_budget_belongs_to_a_calibration(example, lqr):
    path = example("budget.toml")
    path.write_text(lqr.read_text() + path.read_text())
    loaded = calibration_file.load(path)
    assert budget_of(loaded.tables) == Budget(20000, 40000, 500, 30000, 0)


def test_the_tables_of_a_calibration_are_told(lqr):
    told = {
        re.match(r"\[(\w+)", key)[1]
        for key in first_column(section("calibration.toml"))
        if key[0] == "["
    }
    assert told == {*tomllib.loads(lqr.read_text()), "budget", "stage"} - {"schema", "digest"}
    tables = calibration_file.TABLES | calibration_file.OPTIONAL
    assert told == tables - {"schema", "digest"}


def test_arrays_of_a_trace_are_told():
    told = section("Traces")
    for dtype in (tick_trace.TICKS, tick_trace.FRAMES):
        assert all(f"`{name}`" in told for name in dtype.names if name != "_")
    arrays = set(re.findall(r"`(\w+)`", told.partition("any backend:")[2]))
    assert arrays > {"ticks", "frames", "calibration", "about"}


def test_the_table_of_authentication_has_the_keys_of_the_shipped_map():
    shipped = tomllib.loads(dbc.SECURED_MAP.read_text(encoding="utf-8"))
    told = section("A map of your bus").partition("### Authenticated frames")[2]
    assert all(f"`{key}`" in told for key in shipped["secoc"])


def test_no_example_is_left_out():
    here = Path(__file__).read_text(encoding="utf-8")
    assert all(f'"{name}"' in here for name in EXAMPLES)
