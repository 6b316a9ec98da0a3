"""Traffic sets from DBC and TOML, and the command that analyses them."""

import json
from pathlib import Path

import pytest

from canroll import dbc
from canroll.cli import bus as command
from canroll.cli.main import parse
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD

MS = 1_000_000
SET = """
bitrate = 250000
[[message]]
name = "a"
id = 0x100
bytes = 8
period_ms = 10
offset_ms = 1.5
jitter_ms = 0.25
node = "one"
[[message]]
name = "b"
id = 0x18FF00F1
bytes = 4
period_ms = 2.5
extended = true
[[message]]
name = "c"
id = 5
bytes = 64
period_ms = 100
fd = true
[[message]]
name = "d"
id = 6
bits = 125
period_ms = 20
"""
COUNTER_EXAMPLE = """
bitrate = 125000
message = [
  { name = "A", id = 1, bits = 125, period_ms = 2.5 },
  { name = "B", id = 2, bits = 125, period_ms = 3.5 },
  { name = "C", id = 3, bits = 125, period_ms = 3.5 },
]
"""


def write(folder, text):
    path = folder / "set.toml"
    path.write_text(text)
    return path


def run(*arguments):
    return command.run(parse(["bus", *map(str, arguments)]))


def test_a_toml_set_is_read_as_it_says(tmp_path):
    traffic = load_traffic(write(tmp_path, SET))
    assert traffic.bitrate == 250_000
    a, b, c, d = traffic.messages
    assert (a.ident, a.length, a.period_ns, a.offset_ns, a.jitter_ns, a.sender) == (
        0x100,
        8,
        10 * MS,
        1_500_000,
        250_000,
        "one",
    )
    assert (b.flags, b.period_ns) == (EXTENDED, 2.5 * MS)
    assert c.flags == FD | BIT_RATE_SWITCH
    assert d.bits == 125
    assert load_traffic(write(tmp_path, SET), bitrate=1_000_000).bitrate == 1_000_000


def test_the_contract_is_read_with_its_cycle_times():
    traffic = load_traffic(dbc.PATH)
    found = {m.name: m for m in traffic.messages}
    assert len(found) == len(dbc.load().messages)
    assert found["Imu"].period_ns == 10 * MS
    # sent on events as well: its period is the least distance, a tick
    assert found["SuspensionForceCommand"].period_ns == 10 * MS
    assert found["RollControlStatus"].period_ns == 100 * MS
    assert found["Imu"].sender == "Imu"


FD_DBC = """VERSION ""
NS_ :
BS_:
BU_: Radar Camera
BO_ 2566844672 Targets: 64 Radar
 SG_ a : 0|8@1+ (1,0) [0|0] "" Camera
BO_ 100 Lines: 32 Camera
 SG_ a : 0|8@1+ (1,0) [0|0] "" Radar
BO_ 101 Classic: 8 Camera
 SG_ a : 0|8@1+ (1,0) [0|0] "" Radar
BA_DEF_ "Baudrate" INT 0 1000000;
BA_DEF_ "BaudrateCANFD" INT 0 16000000;
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_ BO_ "VFrameFormat" ENUM {frames};
BA_DEF_ BO_ "CANFD_BRS" ENUM "0","1";
BA_DEF_DEF_ "Baudrate" 500000;
BA_DEF_DEF_ "BaudrateCANFD" 2000000;
BA_DEF_DEF_ "GenMsgCycleTime" 20;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "CANFD_BRS" "1";
BA_ "Baudrate" 250000;
BA_ "BaudrateCANFD" 4000000;
BA_ "VFrameFormat" BO_ 2566844672 15;
BA_ "VFrameFormat" BO_ 100 14;
BA_ "CANFD_BRS" BO_ 100 0;
""".format(
    frames=",".join(
        f'"{name}"'
        for name in (
            "StandardCAN",
            "ExtendedCAN",
            *("reserved",) * 12,
            "StandardCAN_FD",
            "ExtendedCAN_FD",
        )
    )
)


@pytest.mark.parametrize(
    ("without", "rates", "switched"),
    [
        ("nothing", (250_000, 4_000_000), [True, False]),
        ('BA_ "Baudrate', (500_000, 2_000_000), [True, False]),
        ('BA_ "CANFD_BRS', (250_000, 4_000_000), [True, True]),
        ("CANFD_BRS", (250_000, 4_000_000), [True, True]),
        ("BaudrateCANFD", (250_000, 0), [True, False]),
    ],
)
def test_a_dbc_tells_its_data_bit_rate_and_which_frames_switch(tmp_path, without, rates, switched):
    path = tmp_path / "fd.dbc"
    path.write_text("".join(x for x in FD_DBC.splitlines(keepends=True) if without not in x))
    traffic = load_traffic(path)
    assert (traffic.bitrate, traffic.data_bitrate) == rates
    targets, lines, classic = traffic.messages
    assert [m.flags & FD for m in traffic.messages] == [FD, FD, 0]
    assert [bool(m.flags & BIT_RATE_SWITCH) for m in (targets, lines)] == switched
    assert targets.flags & EXTENDED
    assert classic.flags == 0
    assert load_traffic(path, data_bitrate=5_000_000).data_bitrate == 5_000_000


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("bitrate = 250000", "bitrate = 0", "bitrate"),
        ("bitrate = 250000", "bitrate = 250000\ndata_bitrate = 125000", "at least the 250000"),
        ("bitrate = 250000", "bitrat = 250000", "did you mean 'bitrate'"),
        ("id = 0x100", "", "'id' is missing"),
        ("id = 0x100", "id = 0x800", "11 bits"),
        ("id = 0x100", "id = -1", "an integer"),
        ("bytes = 8", "bytes = 9", "9 is not a valid payload length"),
        ("bytes = 8", "byts = 8", "did you mean 'bytes'"),
        ("bytes = 8", "bytes = 8\nbits = 100", "not both"),
        ("period_ms = 10\n", "period_ms = 0\n", "period_ms"),
        ("period_ms = 10\n", 'period_ms = "10"\n', "period_ms"),
        ('name = "b"', 'name = "a"', "two messages"),
        ("[[message]]", "[message", "set.toml"),
    ],
)
def test_a_broken_set_says_what_is_wrong(tmp_path, old, new, word):
    assert old in SET
    with pytest.raises(CanrollError, match=word) as caught:
        load_traffic(write(tmp_path, SET.replace(old, new, 1)))
    assert "\n" not in str(caught.value)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "x.dbc").write_text("this is no dbc")
    for name, word in (
        ("x.dbc", "not a readable DBC"),
        ("y.toml", "no such file"),
        ("z.csv", ".dbc"),
    ):
        with pytest.raises(CanrollError, match=word):
            load_traffic(tmp_path / name)
    with pytest.raises(CanrollError, match="no periodic message"):
        load_traffic(write(tmp_path, "bitrate = 1000"))


WITHOUT_PERIODS = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 100 First: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A
BO_ 101 Long: 48 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A
CM_ 100 "no kind";
"""


def test_a_dbc_without_cycle_times_says_what_it_lacks_and_what_helps(tmp_path):
    path = tmp_path / "car.dbc"
    path.write_text(WITHOUT_PERIODS)
    lacking = r"GenMsgCycleTime is missing for 2\): 'canroll bus' takes --period MS .* log"
    with pytest.raises(CanrollError, match=lacking):
        load_traffic(path)


def test_a_period_is_that_of_the_messages_without_one(tmp_path):
    path = tmp_path / "car.dbc"
    cycle = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\nBA_ "GenMsgCycleTime" BO_ 100 20;\n'
    path.write_text(WITHOUT_PERIODS + cycle)
    assert load_traffic(path).left_out == ("Long",)
    traffic = load_traffic(path, period_ms=2.5)
    assert {m.name: m.period_ns for m in traffic.messages} == {"First": 20 * MS, "Long": 2.5 * MS}
    assert traffic.left_out == ()


def test_what_a_database_lacks_is_warned_of(tmp_path):
    path = tmp_path / "car.dbc"
    path.write_text(WITHOUT_PERIODS)
    traffic = load_traffic(path, period_ms=10)
    lenient, fd = traffic.warnings
    assert "line 9" in lenient and "taken as CAN FD, as longer than 8 bytes: Long" in fd
    assert [(m.length, m.flags & FD) for m in traffic.messages] == [(8, 0), (48, FD)]


def test_the_command_prints_the_json_it_promises(tmp_path, capsys):
    assert run(write(tmp_path, COUNTER_EXAMPLE), "--json", "--simulate", 2) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["utilisation"] == pytest.approx(1 / 2.5 + 2 / 3.5)
    assert result["messages"]["C"] == {
        "response_bound_ms": 3.5,
        "response_min_ms": 2.5,
        "response_mean_ms": pytest.approx(3.0, abs=0.01),
        "response_max_ms": 3.5,
    }


def test_a_bound_that_does_not_exist_is_null(tmp_path, capsys):
    overloaded = COUNTER_EXAMPLE.replace("2.5", "1.5")
    assert run(write(tmp_path, overloaded), "--json", "--simulate", 0) == 1
    result = json.loads(capsys.readouterr().out)["messages"]
    assert [result[n]["response_bound_ms"] for n in "ABC"] == [2.0, 5.0, None]
    assert result["A"]["response_max_ms"] is None


def test_the_command_compares_delay_bounds_with_simulated_ages(capsys):
    assert run(dbc.PATH, "--json", "--simulate", 4, "--bitrate", 250000) == 0
    result = json.loads(capsys.readouterr().out)
    delay = result["delay"]
    assert 0 < delay["age_min_ms"] < delay["age_max_ms"] <= delay["age_bound_ms"]
    assert delay["age_max_ms"] > 0.7 * delay["age_bound_ms"]
    for message in result["messages"].values():
        assert message["response_max_ms"] <= message["response_bound_ms"]


def test_the_table_names_every_message(capsys):
    assert run(dbc.PATH, "--simulate", 1, "--worst-case-lengths") == 0
    text = capsys.readouterr().out
    for message in dbc.load().messages:
        assert message.name in text
    assert "sample-to-force age" in text


def test_the_command_refuses_nonsense(tmp_path):
    with pytest.raises(CanrollError, match="--simulate"):
        run(dbc.PATH, "--simulate", -1)
    with pytest.raises(CanrollError, match="bit rate"):
        run(dbc.PATH, "--bitrate", -1)
    with pytest.raises(UnknownNameError):
        run(write(tmp_path, "nonsense = 1"))
    with pytest.raises(CanrollError, match="no such file"):
        run(Path("nosuch.dbc"))


EVENT_DBC = """VERSION ""
BU_: Gateway
BO_ 160 Cyclic: 8 Gateway
 SG_ a : 0|8@1+ (1,0) [0|0] "" Gateway
BO_ 300 Event: 8 Gateway
 SG_ a : 0|8@1+ (1,0) [0|0] "" Gateway
BO_ 301 Distant: 8 Gateway
 SG_ a : 0|8@1+ (1,0) [0|0] "" Gateway
BO_ 2633834494 Parts: 200 Gateway
 SG_ far : 1584|8@1+ (1,0) [0|255] "" Gateway
BA_DEF_ BO_ "GenMsgCycleTime" FLOAT 0 65535;
BA_DEF_ BO_ "GenMsgDelayTime" INT 0 65535;
BA_DEF_ BO_ "GenMsgSendType" ENUM "Cyclic","OnEvent","NoMsgSendType";
BA_DEF_DEF_ "GenMsgCycleTime" 200;
BA_DEF_DEF_ "GenMsgDelayTime" 0;
BA_DEF_DEF_ "GenMsgSendType" "Cyclic";
BA_ "GenMsgCycleTime" BO_ 160 12.5;
BA_ "GenMsgSendType" BO_ 300 1;
BA_ "GenMsgSendType" BO_ 301 1;
BA_ "GenMsgDelayTime" BO_ 301 50;
"""


def test_what_a_database_assumes_and_leaves_out_is_named(tmp_path):
    """Times of 12.5 ms are exact; J1939 messages longer than any frame are sent in parts."""
    path = tmp_path / "events.dbc"
    path.write_text(EVENT_DBC)
    traffic = load_traffic(path)
    periods = {message.name: message.period_ns for message in traffic.messages}
    assert periods == {"Cyclic": 12_500_000, "Event": 200 * MS, "Distant": 50 * MS}
    long, events = traffic.warnings
    assert "longer than 64 bytes" in long and long.endswith(": Parts")
    assert "sent on events" in events and events.endswith(": Event 200 ms")
