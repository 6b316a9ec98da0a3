"""``canroll hil --check``: the rule on given numbers, what is read, and one whole measurement."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from canroll.cli.main import main
from canroll.errors import CanrollError
from hil.check import judgement, machine
from hil.check.judgement import Measurements
from hil.check.loops import ECU, PLANT, SPARE, LoopTimes, Placement
from hil.check.machine import Core, Counters, HostMachine
from hil.check.round_trip import RoundTrip
from hil.check.workers import Child, ended


def us(*values):
    return np.array(values, np.int64) * 1000


MACHINE = HostMachine(
    cores=(Core(0, isolated=False), Core(1, isolated=False)),
    kernel="6.1",
    realtime_kernel=False,
    hypervisor=False,
    clocksource="tsc",
    rt_runtime=0.95,
    quota=None,
    rtprio_limit=99,
    memlock_limit=None,
)
QUIET = Measurements(
    machine=MACHINE,
    loops=(
        LoopTimes(Placement(0, PLANT, 50), us(5, 80), own_s=0.1),
        LoopTimes(Placement(1, ECU, 60), us(5, 100), us(20, 50), own_s=0.2),
    ),
    bus=RoundTrip("socketcan vcan0", us(60, 250), us(2)),
    seconds=10.0,
    counted=Counters({0: 0.2, 1: 0.3}, {0: 0.0, 1: 0.0}, 0),
    resolution_ns=1,
)


def with_machine(**changes):
    return replace(QUIET, machine=replace(MACHINE, **changes))


def with_ecu(**changes):
    plant, ecu = QUIET.loops
    return replace(QUIET, loops=(plant, replace(ecu, **changes)))


def test_a_tick_holds_the_worst_of_everything_in_half_its_period():
    assert judgement.needed_us(QUIET) == (100 + 50 + 250, 80)
    assert judgement.shortest_ms(QUIET) == 1.0
    at_the_limit = with_ecu(late_ns=us(200))
    assert judgement.needed_us(at_the_limit)[0] == 500
    assert judgement.holds(at_the_limit, 1.0)
    beyond = with_ecu(late_ns=us(200) + 1)
    assert not judgement.holds(beyond, 1.0)
    assert judgement.shortest_ms(beyond) == 2.0


def test_no_tick_is_held_where_the_worst_is_longer_than_all():
    assert judgement.shortest_ms(with_ecu(late_ns=us(10_001))) is None


def test_a_late_plant_counts_and_a_spare_core_does_not():
    plant, ecu = QUIET.loops
    late = us(3000)
    assert not judgement.holds(replace(QUIET, loops=(replace(plant, late_ns=late), ecu)), 5.0)
    spare = LoopTimes(Placement(2, SPARE, 50), late)
    assert judgement.holds(replace(QUIET, loops=(plant, ecu, spare)), 1.0)


def test_a_bus_without_round_trip_is_left_out_of_the_sum():
    alone = replace(QUIET, bus=RoundTrip("slcan tty", us(), us(2), missing="one program"))
    assert judgement.needed_us(alone)[0] == 150


def test_a_bus_that_nothing_comes_back_on_holds_no_tick():
    silent = RoundTrip("socketcan vcan0", us(), us(2), lost=5, missing="none of 5 came back")
    assert judgement.holds(QUIET, 20)
    assert judgement.shortest_ms(replace(QUIET, bus=silent)) is None


def test_a_quiet_machine_has_nothing_to_mend():
    assert judgement.findings(QUIET) == []


def core(**changes):
    return (replace(MACHINE.cores[0], **changes), MACHINE.cores[1])


@pytest.mark.parametrize(
    ("seen", "what", "remedy"),
    [
        (with_machine(cores=core(governor="powersave")), "governor 'powersave'", "cpupower -c 0"),
        (
            with_machine(cores=core(idle_state="C6", idle_exit_us=133)),
            "C6, 133 µs to wake",
            "idle-set -D 99",
        ),
        (with_machine(cores=MACHINE.cores[:1]), "one core for ECU and plant", "two"),
        (with_machine(quota=0.1), "0.1 cores, throttled 0 times", "cpu.max"),
        (with_machine(rt_runtime=0.01), "1 % of the time and a loop used 2 %", "rt_runtime_us=-1"),
        (with_machine(clocksource="hpet"), "clock source is hpet", "clocksource=tsc"),
        (replace(QUIET, resolution_ns=4_000_000), "steps of 4000 µs", "highres=on"),
        (
            replace(QUIET, counted=Counters({0: 3.1, 1: 0.2}, {0: 0.0}, 0)),
            "other programs used 30 % of core 0",
            "isolcpus=0",
        ),
        (
            replace(QUIET, counted=Counters({0: 0.1, 1: 0.2}, {0: 0.02, 1: 0.0}, 0)),
            "hypervisor took 20 ms",
            "exclusive cores",
        ),
        (
            with_ecu(
                notes=("no real-time priority (not permitted): run as root",), slack_ns=50_000
            ),
            "no real-time priority (not permitted), ulimit -r is 99",
            "run as root",
        ),
        (
            with_ecu(notes=("memory not locked (no memory): 'ulimit -l unlimited'",)),
            "ulimit -l is unlimited",
            "ulimit -l unlimited",
        ),
    ],
)
def test_what_is_found_is_said_with_what_mends_it(seen, what, remedy):
    found = judgement.findings(seen)[0]
    assert what in found.what
    assert remedy in found.remedy
    assert "\n" not in str(found)


def test_timer_slack_matters_to_ordinary_processes_alone():
    assert judgement.findings(with_ecu(slack_ns=50_000)) == []
    refused = with_ecu(notes=("no real-time priority (x): y",), slack_ns=50_000)
    assert any("50 µs late (slack)" in found.what for found in judgement.findings(refused))


def test_others_on_an_isolated_core_are_not_told_to_isolate_it():
    busy = Counters({0: 5.0, 1: 0.2}, {}, 0)
    seen = replace(QUIET, machine=replace(MACHINE, cores=core(isolated=True)), counted=busy)
    assert "isolcpus" not in judgement.findings(seen)[0].remedy


@pytest.mark.parametrize(
    ("text", "cores"),
    [("", set()), ("1", {1}), ("0-2,5", {0, 1, 2, 5}), ("3-3,7-8\n", {3, 7, 8})],
)
def test_a_list_of_cores(text, cores):
    assert machine.core_list(text) == cores


@pytest.fixture
def tree(tmp_path):
    """A machine's /proc and /sys, as files."""

    def write(path, text):
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")

    cpus = "sys/devices/system/cpu"
    write(f"{cpus}/isolated", "1\n")
    write(f"{cpus}/cpu1/cpufreq/scaling_governor", "powersave\n")
    for number, (name, latency, off) in enumerate((("POLL", 0, 0), ("C1", 2, 0), ("C6", 133, 1))):
        for key, value in (("name", name), ("latency", latency), ("disable", off)):
            write(f"{cpus}/cpu1/cpuidle/state{number}/{key}", f"{value}\n")
    write("proc/sys/kernel/sched_rt_runtime_us", "950000\n")
    write("proc/sys/kernel/sched_rt_period_us", "1000000\n")
    write("proc/cpuinfo", "processor : 0\nflags : fpu tsc hypervisor\n")
    write("proc/self/cgroup", "0::/user/job\n")
    write("sys/fs/cgroup/user/cpu.max", "50000 100000\n")
    write("sys/fs/cgroup/user/job/cpu.max", "max 100000\n")
    write("sys/fs/cgroup/user/job/cpu.stat", "usage_usec 5\nnr_throttled 7\n")
    write("proc/stat", "cpu 1 2 3 4 5 6 7 8 9 10\ncpu1 100 0 50 900 3 4 6 20 0 0\nintr 5\n")
    return tmp_path


def test_what_the_machine_says_is_read(tree):
    read = machine.read([0, 1], tree)
    assert read.cores[0] == Core(0, isolated=False)
    assert read.cores[1] == Core(1, True, "powersave", "C1", 2)
    assert (read.hypervisor, read.rt_runtime, read.quota) == (True, 0.95, 0.5)
    assert (read.clocksource, read.realtime_kernel) == (None, False)


def test_what_the_machine_counts_is_read(tree):
    counted = machine.counters(tree)
    assert counted.busy == {1: pytest.approx(160 / machine.HERTZ)}
    assert counted.steal == {1: pytest.approx(20 / machine.HERTZ)}
    assert counted.throttled == 7
    before = Counters({1: 0.5}, {1: 0.05}, 4)
    assert counted.since(before).throttled == 3
    assert counted.since(before).busy[1] == pytest.approx(160 / machine.HERTZ - 0.5)


def test_the_quota_of_the_older_control_groups(tree):
    (tree / "proc/self/cgroup").write_text("4:memory:/x\n1:cpu,cpuacct:/box\n")
    folder = tree / "sys/fs/cgroup/cpu,cpuacct/box"
    folder.mkdir(parents=True)
    (folder / "cpu.cfs_quota_us").write_text("20000\n")
    (folder / "cpu.cfs_period_us").write_text("100000\n")
    assert machine.read([0], tree).quota == 0.2


def test_a_machine_that_says_nothing_is_unknown(tmp_path):
    read = machine.read([0], tmp_path)
    assert (read.clocksource, read.rt_runtime, read.quota) == (None, None, None)
    assert machine.counters(tmp_path) == Counters({}, {}, 0)


def test_a_measuring_process_that_dies_is_told():
    child = Child(sys.exit)
    with ended([child]), pytest.raises(CanrollError, match="ended early"):
        child.receive(60)


@pytest.mark.slow
def test_the_whole_check(capsys):
    code = main(["hil", "--check", "--duration", "1", "--tick", "20", "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert code == (0 if answer["held"] else 1)
    assert answer["tick_ms"] == 20
    assert answer["held"] == answer["ticks"]["20"]
    assert list(answer["ticks"]) == ["20", "10", "5", "2", "1"]
    assert {loop["role"] for loop in answer["loops"]} >= {"ECU", "plant"}
    for loop in answer["loops"]:
        counts = loop["histogram"]["histogram"].values()
        # a loop that is held up skips periods, so that it may have fewer than one a millisecond
        assert 0 < sum(counts) == loop["histogram"]["count"] <= 751
        assert 0 <= loop["late_us"]["min"] <= loop["late_us"]["p99.9"] <= loop["late_us"]["max"]
    ecu = next(loop for loop in answer["loops"] if loop["role"] == "ECU")
    needed = ecu["late_us"]["max"] + answer["tick_us"]["max"]
    trips = answer["bus"]["round_trip_us"]
    if trips is None:
        # so busy a machine that no echo came back in time: it says so and is not judged fit
        assert "came back" in answer["bus"]["missing"]
        assert not answer["held"]
    else:
        assert answer["needed_us"]["ecu"] == pytest.approx(needed + trips["max"])
        assert answer["bus"]["missing"] is None
    assert all(found["what"] and found["remedy"] for found in answer["findings"])


@pytest.mark.slow
def test_the_check_on_the_terminal(capsys):
    code = main(["hil", "--check", "--duration", "0.5"])
    said = capsys.readouterr().out
    word = {0: "can", 1: "cannot"}[code]
    assert f"This machine {word} keep a tick of 10 ms" in said
    assert "tick of the firmware" in said


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--check", "--out", "x"], "--out: --check writes no files"),
        (["--check", "--duration", "0"], "0.5 to 3600 s"),
        (["--check", "-i", "socketcan", "-c", "nosuch0"], "nosuch0"),
        (["--check", "no_manoeuvre"], "unknown scenario"),
        ([], "a manoeuvre is required"),
    ],
)
def test_what_cannot_be_checked_is_one_line(arguments, says, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["hil", *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error or "modprobe" in error
    assert error.count("\n") == 1
