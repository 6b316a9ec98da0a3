"""ECU and plant as programs of their own: a run, and what happens when one of them goes.

What must hold on any machine is tested in lock step; a run in real time is tested for being
consistent with whatever the machine made of it.
"""

import json
import os
import re
import signal
import socket
import time
from pathlib import Path

import can
import numpy as np
import pytest
from support.forked import real_processes

from canroll import dbc
from canroll.cli.main import main
from canroll.hil import plant_record, tick_trace
from canroll.plant_sim.can_bus import DELIVERED


def plant(programs, *arguments, serve="127.0.0.1:0"):
    """A waiting plant on its own bus, and python-can's options to get there."""
    words = ("double_lane_change", "--actuator", "suspension", "--serve", serve)
    program = programs("plant", "plant", *words, *arguments)
    program.wait_for("plant waits")
    served = re.search(r"serving (.*)", program.said)[1]
    return program, served.split(" ")


def start_run(programs, *arguments):
    """A run of two programs, once both are under way: the program and its children's pids."""
    with real_processes():  # which are told apart by their words
        run = programs("hil", "hil", *arguments)
    run.wait_for("with control in")
    children = Path(f"/proc/{run.process.pid}/task/{run.process.pid}/children")
    pids = {}
    for pid in map(int, children.read_text().split()):
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        pids["ecu" if b"ecu" in words else "plant"] = pid
    assert pids.keys() == {"plant", "ecu"}
    return run, pids


def test_lock_step_is_virtual_time(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["double_lane_change", "--law", "lqr", "--duration", "1.5", "--seed", "4"]
    arguments += ["--plant", "roll1"]
    lock_step = ["hil", *arguments, "--pace", "lockstep", "--json", "--out", str(out)]
    assert main(lock_step) == 0
    answer = json.loads(capsys.readouterr().out)
    virtual = tmp_path / "virtual"
    assert main(["run", *arguments, "--json", "--out", str(virtual)]) == 0
    expected = json.loads(capsys.readouterr().out)
    with np.load(out / "trace.npz") as ours, np.load(virtual / "trace.npz") as theirs:
        assert ours.files == theirs.files
        for name in ours.files:
            assert ours[name].tobytes() == theirs[name].tobytes(), name
    timing = answer.pop("timing")
    assert answer.pop("files") and expected.pop("files")
    assert answer == expected
    assert timing["valid"]
    assert not timing["judged"]
    assert (timing["ticks"], timing["frames_lost"], timing["compilations"]) == (150, 0, 0)
    assert timing["start_jitter_us"] is None
    assert timing["speed"] > 0
    for backend in ("python", "native"):
        assert main(["ecu", "--replay", str(out / "ticks.npz"), "--backend", backend]) == 0
    page = (out / "report.html").read_text()
    assert "<h2>Lock step</h2>" in page and '"timing-tick"' in page
    assert main(["run", str(out)]) == 0
    assert (out / "report.html").read_text() == page


@pytest.mark.slow
@pytest.mark.parametrize("options", [["--phase", "1.5"], ["--passive", "hil"]])
def test_lock_step_with_options_is_virtual_time(tmp_path, capsys, options):
    arguments = ["double_lane_change", "--law", "lqr", "--duration", "1.5", "--json", "--out"]
    phase = options if options[0] == "--phase" else []
    for name, command in (("a", ["hil", "--pace", "lockstep", *options]), ("b", ["run", *phase])):
        assert main([*command[:1], *arguments, str(tmp_path / name), *command[1:]]) == 0
    with np.load(tmp_path / "a/trace.npz") as ours, np.load(tmp_path / "b/trace.npz") as theirs:
        for name in ours.files:
            assert ours[name].tobytes() == theirs[name].tobytes(), name


@pytest.mark.slow
def test_a_run_in_real_time_says_what_it_was(tmp_path, capsys):
    """Whatever the machine was doing: a verdict and 0, or the reasons why there is none and 1."""
    out = tmp_path / "out"
    arguments = ["hil", "double_lane_change", "--law", "lqr", "--duration", "1.5"]
    code = main([*arguments, "--json", "--out", str(out)])
    answer = json.loads(capsys.readouterr().out)
    timing = answer["timing"]
    assert timing["valid"] == (not timing["not_valid"]) == (not answer["not_valid"])
    assert timing["compilations"] == 0
    if timing["valid"]:
        assert (code, answer["helps"]) == (0, True)
        assert answer["verdict"].startswith(("Control helps", "Mixed"))
    else:
        assert (code, answer["helps"], answer["standard"]) == (1, None, None)
        assert answer["verdict"] == f"Not valid: {'; '.join(timing['not_valid'])}"
    assert ('class="greyed"' in (out / "report.html").read_text()) == (not timing["valid"])
    for name in ("start_jitter_us", "tick_us"):
        figures = timing[name]
        assert list(figures) == ["min", "p50", "p99", "p99.9", "max"]
        assert list(figures.values()) == sorted(figures.values())
    assert timing["histograms"]["tick"]["count"] == timing["ticks"]
    cores = json.loads((out / "timing.json").read_text())["cpu"]
    assert sum(len(core["histogram"]) > 0 for core in cores.values()) == len(cores)
    for name in answer["files"].values():
        assert Path(name).stat().st_size > 0
    assert main(["ecu", "--replay", str(out / "ticks.npz"), "--backend", "python"]) == 0


@pytest.mark.slow
def test_where_to_watch_a_run_is_said(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    arguments = ["hil", "double_lane_change", "--law", "lqr", "--duration", "0.5"]
    main([*arguments, "--serve", f"127.0.0.1:{port}", "--out", str(tmp_path)])
    bus = f"-i socketcand -c plant --bus-kwargs host=127.0.0.1 port={port}"
    assert f"to watch: canroll watch {bus}\n" in capsys.readouterr().err


@pytest.mark.slow
def test_a_program_that_falls_over_is_quoted(tmp_path, capsys):
    """The plant cannot be served where somebody else listens; nothing is left running."""
    arguments = ["hil", "double_lane_change", "--law", "lqr", "-i", "socketcand", "-c", "plant"]
    bus = ["--bus-kwargs", "host=127.0.0.1", "port=1"]
    assert main([*arguments, *bus, "--json"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("canroll: plant: no socketcand server at 127.0.0.1:1")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["plant", "double_lane_change", "--phase", "1"], "in real time to 'canroll ecu'"),
        (["plant", "double_lane_change", "--peer-timeout", "-1"], "must be at least 0"),
        (["hil", "double_lane_change", "--phase", "12"], "got 12 ms"),
    ],
)
def test_options_that_cannot_be_are_one_line(arguments, told, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


@pytest.mark.long
def test_the_budget_for_the_host_is_judged(calibration_file, tmp_path, capsys):
    """What no machine meets fails with 1; what any meets passes where the run was valid."""
    command = ["timing", "--hil", "--duration", "0.6", "--json", "--calibration"]
    for limit, met in ((1e-3, False), (1e9, True)):
        path = tmp_path / "calibration.toml"
        table = f"\n[budget]\ntick_p99_us = {limit}\nlatency_p99_us = {limit}\nmisses = 1000\n"
        path.write_text(calibration_file.read_text() + table)
        returned = main([*command, str(path)])
        answer = json.loads(capsys.readouterr().out)
        if answer["timing"]["not_valid"]:
            assert (returned, answer["verdict"]) == (1, "not valid")
        elif len(os.sched_getaffinity(0)) == 1:
            assert (returned, answer["verdict"]) == (0, "not judged")
        else:
            assert (returned, answer["verdict"]) == (0 if met else 1, "PASS" if met else "FAIL")
            assert [v["ok"] for v in answer["verdicts"].values()] == [True, met, met]


@pytest.mark.slow
@pytest.mark.parametrize("tick", [20, 1])
def test_every_tick_rate_controls(tick, capsys):
    arguments = ["double_lane_change", "--tick", str(tick), "--law", "lqr"]
    arguments += ["--duration", "3", "--json"]
    assert main(["hil", *arguments, "--pace", "lockstep"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["tick_ms"] == tick
    assert answer["timing"]["ticks"] == 3000 / tick
    roll = [answer[name]["roll_max_deg"] for name in ("passive", "controlled")]
    assert roll[1] < 0.75 * roll[0]
    assert main(["run", *arguments]) == 0
    assert json.loads(capsys.readouterr().out)["controlled"] == answer["controlled"]


LONG_RUN = ("random_road", "--law", "lqr", "--set", "duration=100")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pace", "side"),
    [("realtime", "ecu"), pytest.param("lockstep", "plant", marks=pytest.mark.long)],
)
def test_a_killed_side_leaves_no_verdict(programs, tmp_path, pace, side):
    run, pids = start_run(programs, *LONG_RUN, "--pace", pace, "--out", tmp_path / "out")
    os.kill(pids[side], signal.SIGKILL)
    assert run.end() == 1, run.said
    name = {"plant": "plant", "ecu": "ECU"}[side]
    assert run.said.splitlines()[-1] == f"canroll: not valid: the {name} was killed by SIGKILL"
    for pid in pids.values():
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.long
def test_a_side_that_stands_still_changes_nothing_in_lock_step(programs, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["random_road", "--law", "lqr", "--set", "duration=8"]
    run, pids = start_run(programs, *arguments, "--pace", "lockstep", "--out", out)
    for pid in pids.values():
        os.kill(pid, signal.SIGSTOP)
        time.sleep(1.5)
        os.kill(pid, signal.SIGCONT)
    assert run.end() in (0, 1), run.said
    assert "Not valid" not in run.said
    assert main(["run", *arguments, "--out", str(tmp_path / "virtual")]) in (0, 1)
    with np.load(out / "trace.npz") as ours, np.load(tmp_path / "virtual/trace.npz") as theirs:
        for name in ours.files:
            assert ours[name].tobytes() == theirs[name].tobytes(), name


@pytest.mark.slow
@pytest.mark.parametrize("side", [pytest.param("plant", marks=pytest.mark.long), "ecu"])
def test_a_side_that_stood_still_leaves_no_verdict_in_real_time(programs, tmp_path, side):
    run, pids = start_run(programs, *LONG_RUN, "--out", tmp_path / "out")
    os.kill(pids[side], signal.SIGSTOP)
    time.sleep(1.5)
    os.kill(pids[side], signal.SIGCONT)
    assert run.end() == 1, run.said
    assert re.search("[Nn]ot valid: ", run.said), run.said


@pytest.mark.slow
def test_either_side_rejoins_after_a_restart(programs, calibration_file, tmp_path):
    """In lock step time stands still while an ECU is away; it is no valid run with one ECU."""
    stay = ("--peer-timeout", 0, "--pace", "lockstep")
    record = tmp_path / "plant.npz"
    vehicle, bus = plant(programs, *stay, "--record", record)
    options = (*bus, "--calibration", calibration_file, *stay)
    first = programs("ecu", "ecu", *options, "--duration", 0.5)
    assert first.end() == 0
    assert "(duration over)" in first.said
    second = programs("ecu", "ecu", *options, "--trace", tmp_path / "ticks.npz")
    assert vehicle.end() == 1
    assert "(finished)" in vehicle.said
    assert "canroll: not valid: the ECU was lost, another one joined at 0.51 s" in vehicle.said
    second.process.send_signal(signal.SIGTERM)
    assert second.end() == 1
    assert "canroll: not valid: joined in tick 51 of a run" in second.said
    trace = tick_trace.load(tmp_path / "ticks.npz")
    assert trace.ticks["number"][0] == 51
    assert trace.ticks["number"][-1] == 697
    modes = tick_trace.replay(trace, "python").rows["mode"]
    assert list(modes[np.flatnonzero(np.diff(modes, prepend=255))][:2]) == [0, 1]
    assert plant_record.load(record).signals["command_held"][-1] == 1


@pytest.mark.slow
def test_stopped_ecu_commands_zero_and_leaves_its_files(programs, calibration_file, tmp_path):
    trace, log, mf4 = tmp_path / "ticks.npz", tmp_path / "bus.blf", tmp_path / "signals.mf4"
    record = tmp_path / "plant.npz"
    files = ("--log", log, "--signals", mf4, "--record", record, "--pace", "lockstep")
    vehicle, bus = plant(programs, *files)
    options = ("--calibration", calibration_file, "--pace", "lockstep")
    ecu = programs("ecu", "ecu", *bus, *options, "--trace", trace, "--duration", 2.5)
    assert ecu.end() == 0
    assert "ECU ends (duration over) in ACTIVE: 250 ticks" in ecu.said
    assert vehicle.end() == 1
    assert "(peer lost) after 2.61 s" in vehicle.said
    assert "canroll: not valid: the ECU ended at 2.51 s" in vehicle.said
    frames = plant_record.load(record).frames
    commands = frames[(frames["ident"] == 0x80) & (frames["outcome"] == DELIVERED)]
    last = dbc.load().decode_message(0x80, commands["payload"][-1][:8].tobytes())
    assert str(last["Mode"]) == "SAFE"
    assert all(value == 0 for name, value in last.items() if name.startswith("Force"))
    with can.LogReader(log) as reader:
        assert sum(m.arbitration_id == 0x80 for m in reader) == len(commands)
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(mf4) as file:
        roll = file.get("roll")
    assert roll.unit == "rad"
    assert np.array_equal(roll.samples, plant_record.load(record).signals["roll"])


@pytest.mark.slow
def test_ctrl_c_ends_everything(programs, tmp_path):
    out = tmp_path / "out"
    run, pids = start_run(programs, *LONG_RUN, "--out", out)
    time.sleep(1.0)
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 130, run.said
    told = rf"canroll: interrupted at \S+ s: {out}/bus.asc has the frames up to then"
    assert re.fullmatch(told, run.said.splitlines()[-1])
    for pid in pids.values():
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    with can.LogReader(out / "bus.asc") as log:
        assert sum(m.arbitration_id == 0xA0 for m in log) > 10
