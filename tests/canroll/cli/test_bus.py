"""The command ``canroll bus``: what it refuses, and its verdict."""

import json
import re
from pathlib import Path

import can
import numpy as np
import pytest

from canroll.cli.main import main
from canroll.network import analysis
from canroll.plant_sim.can_bus import build_network
from canroll.plant_sim.can_bus.bounds.analysis import response_bounds
from canroll.plant_sim.can_bus.simulation.response_times import delivered, traffic_spec
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.runs.logs import write_log

DBC = Path(__file__).parents[3] / "dbc" / "roll_control.dbc"
ROW = """
[[message]]
name = "{name}"
id = {ident}
bytes = 8
period_ms = {period}
"""


def traffic(folder, *, period):
    path = folder / "set.toml"
    names = (("Imu", 0xA0), ("SuspensionForceCommand", 0x80))
    path.write_text("".join(ROW.format(name=n, ident=i, period=period) for n, i in names))
    return str(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--serve", "99999"], "the port must be 0 to 65535"),
        (["--bitrate", "2000000"], "at most 1000000 bit/s"),
        (["--data-bitrate", "250000"], "the data bit rate must be at least the 500000"),
        (["--data-bitrate", "9000000"], "the data bit rate must be at most 8000000"),
        (["--serve", "--replay", "x.log"], "--serve and --replay exclude each other"),
        (["--simulate", "0", "--replay", "x.log"], "--replay needs --simulate above 0"),
        (["--channel", "1"], "--channel selects a channel of a log: --replay is required"),
        (["--sensor", "SuspensionForceCommand"], "both sensor and command"),
        (["--sensor", "Imi"], "did you mean 'Imu'?"),
        (["--command", "SuspensionForce"], "did you mean 'SuspensionForceCommand'?"),
        (["--period", "10"], "--period is of messages without a cycle time"),
        (["--period", "0"], "--period must be at least 0.001"),
        (["--add", "x.toml"], "--add puts messages onto the bus of a log"),
        (["--section", "1"], "--section selects a section of a log"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, capsys, options, message):
    refused(capsys, message, traffic(tmp_path, period=10), *options)


def refused(capsys, message, *words):
    """A command is refused in one line."""
    assert main(["bus", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_dbc_without_cycle_times_has_the_period_given_and_its_warnings(tmp_path, capsys):
    path = tmp_path / "car.dbc"
    text = 'VERSION ""\nBU_: A\nBO_ 100 Motion: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" A\nCM_ 1 "";\n'
    path.write_text(text)
    command = ["bus", str(path), "--simulate", "0.1"]
    assert main(command) == 2
    assert "--period MS" in capsys.readouterr().err
    assert main([*command, "--period", "20"]) == 0
    shown = capsys.readouterr().out
    assert "warning: " in shown and 'line 5 (CM_ 1 "";)' in shown and "Motion" in shown
    assert main([*command, "--period", "20", "--json"]) == 0
    (warning,) = json.loads(capsys.readouterr().out)["warnings"]
    assert 'line 5 (CM_ 1 "";)' in warning


def test_an_overloaded_bus_fails_its_verdict_behind_the_whole_answer(tmp_path, capsys):
    assert main(["bus", traffic(tmp_path, period=10), "--simulate", "0.1"]) == 0
    assert "without a bound" not in capsys.readouterr().out
    assert main(["bus", traffic(tmp_path, period=1), "-b", "125000", "--simulate", "0.1"]) == 1
    text = capsys.readouterr()
    assert "without a bound, bus overloaded" in text.out
    assert "Imu to SuspensionForceCommand" in text.out
    assert text.err == ""


def test_a_tick_too_fast_for_the_bus_fails_the_verdict(tmp_path, capsys):
    command = ["bus", traffic(tmp_path, period=10), "-b", "125000", "--simulate", "0.1", "--tick"]
    assert main([*command, "2.5"]) == 0
    assert main([*command, "1"]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "no bound of the delay, Imu: bus overloaded at this priority; sample-to-force" in text


def test_an_identifier_used_twice_fails_the_verdict(tmp_path, capsys):
    path = tmp_path / "twice.toml"
    rows = [ROW.format(name=n, ident=i, period=10) for n, i in (("a", 5), ("b", 5), ("c", 6))]
    path.write_text("".join(row + f'node = "{i}"' for i, row in enumerate(rows)))
    assert main(["bus", str(path), "--json", "--simulate", "0.1"]) == 1
    found = json.loads(capsys.readouterr().out)["messages"]
    assert [found[name]["response_bound_ms"] for name in "abc"] == [None, None, None]
    # one node alone sends them one after the other: nobody else is hurt
    path.write_text("".join(rows))
    assert main(["bus", str(path), "--json", "--simulate", "0.1"]) == 1
    found = json.loads(capsys.readouterr().out)["messages"]
    assert [found[name]["response_bound_ms"] is None for name in "abc"] == [True, True, False]
    assert found["a"]["response_max_ms"] == found["b"]["response_max_ms"] > 0


def test_a_fifo_queue_has_its_bounds(tmp_path, capsys):
    path = tmp_path / "fifo.toml"
    rows = [ROW.format(name=n, ident=i, period=10) for n, i in (("a", 5), ("b", 6))]
    path.write_text("fifo = true".join(rows))
    assert main(["bus", str(path), "--simulate", "0.1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["messages"]
    assert [found[name]["response_bound_ms"] for name in "ab"] == [0.54, 0.54]


def logged(path, *frames, channels=(0,)):
    with can.Logger(str(path)) as logger:
        for place, (time_s, ident) in enumerate(frames):
            logger(
                can.Message(
                    timestamp=1e9 + time_s,
                    arbitration_id=ident & 0x1FFFFFFF,
                    is_extended_id=ident > 0x7FF,
                    data=bytes(8),
                    channel=channels[place % len(channels)],
                )
            )
    return str(path)


def test_beside_a_recording_there_is_no_bound(tmp_path, capsys):
    """The bounds once stood beside responses three times as long, for they ignored it."""
    burst = [(0.1 + k * 0.00027, 0x10 + k) for k in range(40)]
    log = logged(tmp_path / "burst.log", *burst, (1.5, 0x10))
    command = ["bus", traffic(tmp_path, period=10), "--simulate", "1", "--replay", log]
    assert main(command) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "without a bound, the periods of a recording are unknown: all messages" in text
    assert "age at most" not in text
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["messages"]["Imu"]["response_bound_ms"] is None
    assert found["messages"]["Imu"]["response_max_ms"] > 1.0
    assert found["delay"]["age_bound_ms"] is found["delay"]["tau_max_ms"] is None
    assert found["delay"]["age_max_ms"] > found["delay"]["age_min_ms"] > 0.0
    assert found["recording"] == {
        **{"frames": 41, "duration_s": 1.4, "channel": "can0"},
        **{"error_frames": 0, "remarks": []},
    }


def test_ages_are_simulated_beside_the_whole_recording(tmp_path, capsys):
    def longest(*, at):
        flood = [(0.0, 0x10), *((at + k * 0.0002, 0x10 + k % 40) for k in range(300))]
        log = logged(tmp_path / "flood.log", *flood, (1.0, 0x10))
        command = ["bus", traffic(tmp_path, period=10), "--simulate", "1", "--replay", log]
        assert main([*command, "--json"]) == 0
        return json.loads(capsys.readouterr().out)["delay"]["age_max_ms"]

    quiet = longest(at=5.0)
    assert longest(at=0.0) > quiet + 1.0
    assert longest(at=0.6) > quiet + 1.0


def test_a_recording_shorter_than_the_run_says_so(tmp_path, capsys):
    log = logged(tmp_path / "short.log", (0.0, 0x10), (0.25, 0x10))
    command = ["bus", traffic(tmp_path, period=10), "--replay", log, "--simulate"]
    assert main([*command, "1"]) == 0
    assert "short.log ends after 0.25 s of 1 s" in capsys.readouterr().out
    assert main([*command, "0.25"]) == 0
    assert "ends after" not in capsys.readouterr().out


def test_a_recording_of_several_channels_has_to_be_chosen_from(tmp_path, capsys):
    frames = [(0.1 * k, 0x10 + k % 2) for k in range(10)]
    log = logged(tmp_path / "two.asc", *frames, channels=(0, 1))
    command = ["bus", traffic(tmp_path, period=10), "--simulate", "1", "--json", "--replay", log]
    assert main(command) == 2
    assert "frames of channels 0, 1: choose one with --channel" in capsys.readouterr().err
    assert main([*command, "--channel", "2"]) == 2
    assert "unknown channel" in capsys.readouterr().err
    assert main([*command, "--channel", "1"]) == 0
    assert json.loads(capsys.readouterr().out)["recording"]["frames"] == 5


def test_an_extended_identifier_is_another_one(tmp_path, capsys):
    """The set's 0xA0 has 11 bits: the recorded one of 29 bits is not left out for it."""
    log = tmp_path / "extended.log"
    log.write_text("(1.0) can0 000000A0#00\n(1.1) can0 0A0#00\n")
    command = ["bus", traffic(tmp_path, period=10), "--simulate", "1", "--json"]
    assert main([*command, "--replay", str(log)]) == 0
    assert json.loads(capsys.readouterr().out)["recording"]["frames"] == 1


FD_ROW = ROW.replace("bytes = 8", "bytes = 64\nfd = true")


def test_the_data_bit_rate_can_be_given(tmp_path, capsys):
    path = tmp_path / "fd.toml"
    path.write_text(FD_ROW.format(name="Radar", ident=5, period=10))
    longest = []
    for options in ([], ["--data-bitrate", "2000000"], ["--data-bitrate", "8000000"]):
        assert main(["bus", str(path), "--simulate", "0.1", *options]) == 0
        assert ("no data bit rate" in capsys.readouterr().out) is not bool(options)
        assert main(["bus", str(path), "--simulate", "0", "--json", *options]) == 0
        found = json.loads(capsys.readouterr().out)["messages"]
        longest.append(found["Radar"]["response_bound_ms"])
    assert longest[0] > 2 * longest[1] > 2 * longest[2]


def test_an_age_equal_to_its_bound_is_not_above_it(monkeypatch, capsys):
    bound = {}
    loop_delay = analysis.loop_delay

    def noted(*messages, **rates):
        bound["total"] = loop_delay(*messages, **rates)
        return bound["total"]

    def ages(*messages, **options):
        return np.array([round(bound["total"].age_max * 1e9) + bound["beyond_ns"]])

    monkeypatch.setattr(analysis, "loop_delay", noted)
    monkeypatch.setattr(analysis, "simulate_ages_of_network", ages)
    for bound["beyond_ns"], code in ((0, 0), (1, 1)):
        assert main(["bus", str(DBC), "--simulate", "0.1"]) == code
    assert "above its bound" in capsys.readouterr().err


def recorded(folder, *, suffix=".blf", seconds=6, more=()):
    """A log of a bus at 250 kbit/s with four messages a node, queued at once, and its truth."""
    rows = [(f"m{k}", 0x63 + 0x20 * k, (10, 20, 50)[k % 3]) for k in range(10)]
    messages = [BusMessage(n, i, 8, p * 1e6, f"node{i % 3}") for n, i, p in (*rows, *more)]
    network = build_network(traffic_spec(messages, bitrate=250_000))
    frames = np.concatenate([*delivered(network, seconds * 1_000_000_000)])
    return f"{write_log(folder / f'recording{suffix}', frames)}@250000", messages


def answer_of(capsys, *command, code=0):
    assert main(["bus", *command, "--json"]) == code
    (channel,) = json.loads(capsys.readouterr().out)["channels"].values()
    return channel


def test_a_log_alone_gives_periods_and_bounds_before_and_after_canroll(tmp_path, capsys):
    path, messages = recorded(tmp_path)
    found = answer_of(capsys, path, "--simulate", "2")
    assert found["bitrate"] == 250_000
    assert found["utilisation"]["after"] > found["utilisation"]["before"] > 0.1
    exact = {b.message.ident: b for b in response_bounds(messages, bitrate=250_000)}
    for row in found["messages"].values():
        if row["added"]:
            assert row["response_seen_ms"] <= row["bound_after_ms"]
            continue
        truth = exact[row["id"]]
        assert row["period_ms"] == pytest.approx(truth.message.period_ns * 1e-6, rel=0.01)
        assert truth.bound_ns * 1e-6 <= row["bound_before_ms"] <= row["bound_after_ms"]
        assert row["response_seen_ms"] <= row["bound_before_ms"]
    assert found["messages"]["Recorded183"]["bound_after_ms"] > (
        found["messages"]["Recorded183"]["bound_before_ms"] + 1.0
    )
    assert found["delay"]["tau_max_ms"] > found["delay"]["age_bound_ms"] > 10.0
    # the docs name every key
    page = (DBC.parents[1] / "docs" / "file-formats.md").read_text(encoding="utf-8")
    section = page.partition("### A recorded bus")[2].partition("\n## ")[0]
    keys = {*found, *found["messages"]["Recorded063"], *(found["delay"] or ())}
    assert [key for key in keys if f"`{key}" not in section] == []


def test_the_page_of_a_log_names_its_evidence_and_prints_every_bound_whole(tmp_path, capsys):
    """Once the last column was cut to five characters on a terminal of 80, and names in a pipe."""
    path, _ = recorded(tmp_path, suffix=".pcapng", more=[("Other", 0x91, 30)])
    found = answer_of(capsys, path, "--simulate", "0")
    assert main(["bus", path, "--simulate", "0"]) == 0
    text = capsys.readouterr().out
    words = " ".join(text.split())
    assert "frames in 5.99" in words
    assert "at 250 kbit/s" in words
    assert "Imu to AntiRollBarCommand at a tick of 10 ms: total delay" in words
    assert "after: the bound with canroll" in words
    assert re.search(r"^ *[0-9A-F]+ AntiRollBarCommand ", text, re.MULTILINE)
    bounds = [row["bound_after_ms"] for row in found["messages"].values()]
    assert len(bounds) > 10
    assert [f"{b:.3f}" for b in bounds if f" {b:.3f}" not in text] == []


LONG = "TheMessageOfTheElectronicStabilityProgramWithALongNameAndAnotherOne"


def test_names_are_whole_in_a_pipe(tmp_path, capsys):
    """Once a pipe had 80 columns, and names in it an ellipsis."""
    path = tmp_path / "set.toml"
    text = 'bitrate = 500000\n[[message]]\nname = "{}"\nid = {}\nbytes = 8\nperiod_ms = {}\n'
    second = text.partition("\n")[2].format("Late" + LONG, 257, 1000)
    path.write_text(text.format(LONG, 256, 10) + second)
    main(["bus", str(path), "--simulate", "0.1", "--sensor", LONG, "--command", "Late" + LONG])
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if LONG in line]
    assert [row[:2] for row in rows[:2]] == [[LONG, "100"], ["Late" + LONG, "101"]]


def test_our_recorded_command_is_ours_whatever_the_tick(tmp_path, capsys):
    """It is recorded with its heartbeats, and analysed in every tick: once it met itself."""
    path, _ = recorded(tmp_path, more=[("SuspensionForceCommand", 0x80, 50)])
    for options in ((), ("--command", "SuspensionForceCommand")):
        found = answer_of(capsys, path, "--simulate", "0", *options)
        assert not found["messages"]["Recorded080"]["added"]
        assert found["messages"]["Imu"]["added"]
        assert found["delay"]["tau_max_ms"] > 10.0
    assert main(["bus", path, "--simulate", "0"]) == 0
    assert "Imu to SuspensionForceCommand at a tick" in " ".join(capsys.readouterr().out.split())


def test_a_message_of_ours_that_is_on_the_bus_is_not_added_again(tmp_path, capsys):
    path, _ = recorded(tmp_path, more=[("Imu", 0xA8, 10)])
    sensor = tmp_path / "add.toml"
    sensor.write_text(ROW.format(name="Imu", ident=0xA8, period=10))
    found = answer_of(capsys, path, "--add", str(sensor), "--simulate", "0")
    assert [row["added"] for row in found["messages"].values()] == [False] * 11
    assert found["utilisation"]["after"] == found["utilisation"]["before"]
    # the same identifier with another period is another node's: they collide
    sensor.write_text(ROW.format(name="Imu", ident=0xA8, period=40))
    found = answer_of(capsys, path, "--add", str(sensor), "--simulate", "0", code=1)
    assert {row["bound_after_ms"] for row in found["messages"].values()} == {None}
    reasons = {row["reason"] for row in found["messages"].values()}
    assert reasons == {"identifier 0xA8 used by several nodes: their frames collide"}


def test_more_than_a_recorded_bus_can_carry_fails_the_verdict(tmp_path, capsys):
    path, _ = recorded(tmp_path)
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(ROW.format(name="Flood", ident=0x10, period=0.6))
    found = answer_of(capsys, path, "--add", str(heavy), "--simulate", "0", code=1)
    last = found["messages"]["Recorded183"]
    assert last["bound_after_ms"] is None
    assert last["bound_before_ms"] > 0.0
    assert last["reason"] == "bus overloaded at this priority"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--replay", "x.log"], "--replay needs a traffic set: "),
        (["--serve"], "--serve needs a traffic set: "),
        (["--channel", "7"], "unknown channel of"),
        (["--sensor", "Imi"], "did you mean 'Imu'?"),
        (["--bitrate", "500000"], "has it in its name: omit --bitrate"),
        (["--offsets"], "--offsets needs a traffic set: "),
        (["--add", "nowhere.toml"], "nowhere.toml: no such file"),
    ],
)
def test_what_a_log_cannot_do_is_one_line(tmp_path, capsys, options, message):
    path, _ = recorded(tmp_path, seconds=2)
    refused(capsys, message, path, *options)


DEADLINES = """
bitrate = 125000
message = [
  { name = "Slow", id = 0x10, bytes = 8, period_ms = 100, node = "A", deadline_ms = 100 },
  { name = "Fast", id = 0x20, bytes = 8, period_ms = 5, node = "B", deadline_ms = 3 },
  { name = "Mid", id = 0x30, bytes = 4, period_ms = 10, node = "A", deadline_ms = 10 },
  { name = "Other", id = 0x40, bytes = 8, period_ms = 20, node = "A" },
]
"""


def test_a_missed_deadline_is_printed_and_fails(tmp_path, capsys):
    path = tmp_path / "deadlines.toml"
    path.write_text(DEADLINES)
    assert main(["bus", str(path), "--simulate", "0"]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "deadlines.toml at 125 kbit/s: response times, ms" in text
    assert "deadline missed: Fast (3.240 of 3 ms)" in text
    path.write_text(DEADLINES.replace("deadline_ms = 3 ", "deadline_ms = 5 "))
    assert main(["bus", str(path), "--simulate", "0"]) == 0
    assert "deadline missed" not in capsys.readouterr().out


def test_bounds_take_the_offsets_within_a_node_into_account(tmp_path, capsys):
    path = tmp_path / "offsets.toml"
    path.write_text(DEADLINES.replace('"Mid",', '"Mid", offset_ms = 5,'))
    bounds = []
    for options in ([], ["--offsets"]):
        assert main(["bus", str(path), "--simulate", "0", "--json", *options]) == 1
        found = json.loads(capsys.readouterr().out)["messages"]
        bounds.append(found["Other"]["response_bound_ms"])
    assert bounds[1] < bounds[0]


@pytest.mark.parametrize(("host", "notes"), [("127.0.0.1", 0), ("0.0.0.0", 1)])
def test_a_bus_open_to_the_network_says_so(host, notes, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("canroll.cli.bus_server.serve_network", lambda *_, **__: None)
    assert main(["bus", traffic(tmp_path, period=10), "--serve", "0", "--host", host]) == 0
    assert capsys.readouterr().out.count("anyone who can reach 0.0.0.0 can read and write") == notes


def network(folder, text="gateway_ms = [2, 4]"):
    path = folder / "network.toml"
    path.write_text(f"schema = 1\nbitrate = 500000\nload = 0.3\n{text}\n")
    return str(path)


def network_answer(capsys, *arguments):
    assert main(["bus", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_network_has_bounds_on_every_segment_and_over_its_gateways(tmp_path, capsys):
    options = ("--simulate", "1", "--worst-case-lengths")
    found = network_answer(capsys, network(tmp_path), *options)
    assert set(found["segments"]) == {"ecu", "vehicle"}
    there, here = (
        {m["name"]: m for m in found["segments"][name]["messages"]} for name in ("vehicle", "ecu")
    )
    assert there["Imu"]["way"] == ["vehicle"]
    assert here["Imu"]["way"] == ["vehicle", "ecu"]
    assert here["Imu"]["jitter_ms"] > 2.0
    for row in (there["Imu"], here["Imu"], here["RollControlStatus"]):
        assert 0.0 < row["response_max_ms"] <= row["response_bound_ms"]
        assert 0.0 < row["arrival_max_ms"] <= row["arrival_bound_ms"]
    assert here["Imu"]["arrival_bound_ms"] >= there["Imu"]["arrival_bound_ms"] + 2.0
    assert here["Imu"]["arrival_min_ms"] > 2.0
    delay = found["delay"]
    assert 4.0 < delay["age_min_ms"] < delay["age_max_ms"] <= delay["age_bound_ms"]
    page = (DBC.parents[1] / "docs" / "file-formats.md").read_text(encoding="utf-8")
    section = page.partition("### The bounds of a network")[2].partition("\n## ")[0]
    assert [key for key in {*found["segments"]["ecu"], *here["Imu"]} if key not in section] == []


def test_the_page_of_a_network_names_ways_and_segments(tmp_path, capsys):
    assert main(["bus", network(tmp_path), "--simulate", "0.2"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "network.toml, segment ecu at 500 kbit/s: response times, ms" in text
    assert "Imu vehicle → ecu" in text
    assert "Imu to AntiRollBarCommand at a tick of 10 ms: total delay" in text


def test_a_built_in_bus_is_a_network(capsys):
    found = network_answer(capsys, "500k", "--simulate", "0")
    assert list(found["segments"]) == ["bus"]
    assert "simulated_load" not in found["segments"]["bus"]


def test_a_network_without_a_bound_fails_its_verdict(tmp_path, capsys):
    path = tmp_path / "slow.toml"
    path.write_text("schema = 1\nbitrate = 125000\nload = 0.68\n")
    assert main(["bus", str(path), "--simulate", "0"]) == 0
    capsys.readouterr()
    assert main(["bus", str(path), "--simulate", "0", "--tick", "1"]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "without a bound, bus overloaded at this priority" in text
    assert "no bound of the delay" in text


def test_a_deadline_missed_over_a_gateway_fails_the_verdict(tmp_path, capsys):
    """A deadline in the background of a network was once ignored."""
    row = ROW.format(name="Doors", ident=0x10, period=50) + 'node = "A"\ndeadline_ms = {}\n'
    path = tmp_path / "net.toml"
    path.write_text(
        "schema = 1\n[segment.a]\nbitrate = 500000\nload = 0.3\n"
        '[segment.b]\nbitrate = 500000\ntraffic = "doors.toml"\n'
        '[[gateway]]\nsegments = ["a", "b"]\nlatency_ms = 5\nmessages = ["Doors"]\n'
    )
    command = ["bus", str(path), "--simulate", "0"]
    (tmp_path / "doors.toml").write_text(row.format(20))
    assert main(command) == 0
    assert "deadline" not in capsys.readouterr().out
    (tmp_path / "doors.toml").write_text(row.format(4))
    assert main(command) == 1
    (line,) = re.findall("^deadline missed: .*", capsys.readouterr().out, re.MULTILINE)
    assert re.fullmatch(r"deadline missed: Doors on a \(5\.\d+ of 4 ms\)", line)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--serve"], "--serve needs a traffic set"),
        (["--offsets"], "--offsets needs a traffic set"),
        (["--bitrate", "250000"], "--bitrate is that of the network: set it in"),
        (
            ["--sensor", "Gyro"],
            "unknown --sensor message 'Gyro': choose from ActuatorState, AntiRollBarCommand, Imu",
        ),
        (["--command", "ForceCommand"], "command message"),
        (["--add", "x.toml"], "--add puts messages onto the bus of a log"),
    ],
)
def test_what_a_network_cannot_do_is_one_line(tmp_path, capsys, options, message):
    refused(capsys, message, network(tmp_path), *options)


def write_candump(path, times, *more):
    path.write_text(
        "".join(f"({t:.6f}) can0 172#00000000000000{k % 256:02X}\n" for k, t in enumerate(times))
        + "".join(f"{line}\n" for line in more)
    )
    return str(path)


def test_a_rate_is_stated_behind_the_name_or_by_an_option(tmp_path, capsys):
    log = write_candump(tmp_path / "light.log", [0.01 * k for k in range(200)])
    for words in ((f"{log}@250000",), (log, "--bitrate", "250000")):
        found = answer_of(capsys, *words, "--simulate", "0")
        assert (found["bitrate"], found["remarks"]) == (250_000, [])
    assert main(["bus", f"{log}@2000000"]) == 2
    assert "at most 1000000 bit/s" in capsys.readouterr().err
    for command in (["bus", log], ["run", "moose", "--bus", log]):
        assert main(command) == 2
        error = capsys.readouterr().err
        assert "light.log: channel can0: a log does not say its bit rate" in error
        assert error.endswith("as @500000\n")
        assert error.count("\n") == 1


def test_error_and_remote_frames_and_what_is_left_out_are_said(tmp_path, capsys):
    more = ["(2.1) can0 20000088#0000000000000000"] * 3 + ["(2.2) can0 172#R8", "(2.3) can0 FFF#"]
    log = write_candump(tmp_path / "log.log", [0.01 * k for k in range(200)], *more)
    assert main(["bus", f"{log}@500000", "--simulate", "0"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "201 frames (1 of them remote) in" in text
    assert "3 error frames in the log" in text
    assert "warning: line 205: identifier FFF of a frame with 11 bits: left out" in text
    found = answer_of(capsys, f"{log}@500000", "--simulate", "0")
    assert (found["frames"], found["remote_frames"], found["error_frames"]) == (201, 1, 3)
    command = ["bus", traffic(tmp_path, period=10), "--simulate", "1", "--replay", log]
    assert main(command) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "error frames in log.log, not replayed: 3" in text
    assert "log.log: line 205: identifier FFF" in text


def test_a_section_of_a_log_whose_times_step_is_chosen(tmp_path, capsys):
    times = [0.01 * k + (259_200 if k >= 120 else 0) for k in range(200)]
    log = write_candump(tmp_path / "gap.log", times)
    found = answer_of(capsys, f"{log}@500000", "--simulate", "0")
    assert (found["frames"], found["duration_s"]) == (120, 1.19)
    assert "forward by 3 d at frame 121: section 1 of 2 is read" in found["remarks"][0]
    found = answer_of(capsys, f"{log}@500000", "--simulate", "0", "--section", "2")
    assert (found["frames"], found["duration_s"]) == (80, 0.79)
    command = ["bus", traffic(tmp_path, period=10), "--json", "--replay", log, "--section"]
    assert main([*command, "2"]) == 0
    assert json.loads(capsys.readouterr().out)["recording"]["frames"] == 80
    assert main([*command, "3"]) == 2
    assert "--section 3: there are sections 1 to 2" in capsys.readouterr().err


def test_a_refused_suffix_names_those_that_are_read(tmp_path, capsys):
    text = tmp_path / "log.txt"
    text.write_text("(1.0) can0 0A0#11\n")
    for command, words in (
        (["bus", str(text)], "a bus log ends in .asc, .blf, .log"),
        (["ecu", "--replay", str(text)], "neither a trace (.npz) nor a bus log (.asc, .blf"),
        (["run", "moose", "--bus", str(text)], "the file of a bus ends in .asc, .blf, .log"),
    ):
        assert main(command) == 2
        assert words in capsys.readouterr().err
