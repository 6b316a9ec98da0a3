"""Shortest sustainable tick derived from measurements, and remedies for the machine.

The rule: the sum of the largest wake-up lateness, the longest tick and the largest CAN round trip
is at most half of the period. The other half is a reserve for events too rare for a measurement of
a few seconds. On the plant's core the lateness alone must be within that half.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil.check.loops import ECU, PLANT, SPARE, LoopTimes
from hil.check.machine import Core, Counters, HostMachine
from hil.check.round_trip import RoundTrip

TICKS_MS = (20.0, 10.0, 5.0, 2.0, 1.0)
SHARE = 0.5
"""Of a period, that the worst of everything may take."""
RULE = (
    "largest wake-up lateness + longest tick + largest CAN round trip <= half of the period, "
    "and the plant's wake-up lateness alone as well; no tick where no frame came back"
)
SLACK_NS = 1000
OTHERS = 0.05
"""Share of a core's time above which other programs on it are reported."""
IDLE_EXIT_US = 100


@dataclass(frozen=True, slots=True)
class Measurements:
    """Measurements of the loops and settings of the machine.

    Attributes:
        seconds: duration of the loops, s.
        counted: change of the machine's counters meanwhile.
        resolution_ns: resolution of the loops' clock.
    """

    machine: HostMachine
    loops: Sequence[LoopTimes]
    bus: RoundTrip
    seconds: float
    counted: Counters
    resolution_ns: int


@dataclass(frozen=True, slots=True)
class CheckFinding:
    """A cause of longer ticks, read or measured, with its remedy."""

    what: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what}: {self.remedy}"


def needed_us(seen: Measurements) -> tuple[float, float]:
    """Return the worst-case demand within the ECU's and the plant's period, µs."""
    ecu = plant = 0.0
    for loop in seen.loops:
        late = _largest(loop.late_ns)
        if loop.place.role == ECU:
            ecu = late + _largest(loop.ticks_ns) + _largest(seen.bus.trips_ns)
        elif loop.place.role == PLANT:
            plant = late
    return ecu, plant


def holds(seen: Measurements, tick_ms: float) -> bool:
    """Return whether a tick of ``tick_ms`` can be sustained, by :data:`RULE`."""
    answered = len(seen.bus.trips_ns) or not seen.bus.lost
    return bool(answered) and max(needed_us(seen)) <= SHARE * tick_ms * 1e3


def shortest_ms(seen: Measurements) -> float | None:
    """Return the shortest of :data:`TICKS_MS` that can be sustained, or None."""
    return min((tick for tick in TICKS_MS if holds(seen, tick)), default=None)


def findings(seen: Measurements) -> list[CheckFinding]:
    """Return the causes of late wake-ups, each with its remedy."""
    return [
        *_refused(seen),
        *_one_core(seen),
        *_cores(seen),
        *_stolen(seen),
        *_limited(seen),
        *_timer(seen),
    ]


def _refused(seen: Measurements) -> list[CheckFinding]:
    """Return the settings refused by the system, merged if the same on every core."""
    notes = {note: None for loop in seen.loops for note in loop.notes}
    machine = seen.machine
    limits = {
        "no real-time priority": f"ulimit -r is {machine.rtprio_limit}",
        "memory not locked": f"ulimit -l is {_kib(machine.memlock_limit)}",
    }
    result = []
    for note in notes:
        what, _, remedy = note.partition(": ")
        limit = next((text for start, text in limits.items() if note.startswith(start)), None)
        result.append(CheckFinding(f"{what}, {limit}" if limit else what, remedy))
    return result


def _one_core(seen: Measurements) -> list[CheckFinding]:
    if len(seen.machine.cores) > 1:
        return []
    return [CheckFinding("one core for ECU and plant", "a machine, or an affinity mask, with two")]


def _cores(seen: Measurements) -> list[CheckFinding]:
    """Return findings on the settings of the run's cores and their use by other programs."""
    flagged = []
    for core in seen.machine.cores:
        loops = [loop for loop in seen.loops if loop.place.core in (core.number, None)]
        if all(loop.place.role == SPARE for loop in loops):
            continue
        if core.governor not in (None, "performance"):
            flagged.append(
                CheckFinding(
                    f"core {core.number} has the frequency governor '{core.governor}'",
                    f"cpupower -c {core.number} frequency-set -g performance",
                )
            )
        if core.idle_exit_us >= IDLE_EXIT_US:
            flagged.append(
                CheckFinding(
                    f"core {core.number} may sleep in {core.idle_state}, "
                    f"{core.idle_exit_us} µs to wake",
                    f"cpupower -c {core.number} idle-set -D {IDLE_EXIT_US - 1}",
                )
            )
        busy = seen.counted.busy.get(core.number, 0.0) - sum(loop.own_s for loop in loops)
        if busy > OTHERS * seen.seconds:
            flagged.append(_others(core, busy / seen.seconds))
    return flagged


def _others(core: Core, share: float) -> CheckFinding:
    what = f"other programs used {100 * share:.0f} % of core {core.number}"
    if core.isolated:
        return CheckFinding(
            what, "it is isolated, so they were assigned to it: see 'ps -eLo psr,pid,comm'"
        )
    return CheckFinding(what, f"end them, or boot with isolcpus={core.number}")


def _stolen(seen: Measurements) -> list[CheckFinding]:
    used = {loop.place.core for loop in seen.loops if loop.place.role != SPARE}
    stolen = sum(s for core, s in seen.counted.steal.items() if core in used or None in used)
    if stolen <= 0:
        return []
    return [
        CheckFinding(
            f"the hypervisor took {1e3 * stolen:.0f} ms from the cores in {seen.seconds:.1f} s",
            "give the virtual machine exclusive cores, or use a real one",
        )
    ]


def _limited(seen: Measurements) -> list[CheckFinding]:
    machine = seen.machine
    flagged = []
    if machine.quota is not None and machine.quota < 2:
        throttled = seen.counted.throttled
        flagged.append(
            CheckFinding(
                f"the control group may use {machine.quota:g} cores, throttled {throttled} times",
                "lift its quota (cpu.max, docker --cpus)",
            )
        )
    used = max((loop.own_s for loop in seen.loops), default=0.0) / max(seen.seconds, 1e-9)
    if machine.rt_runtime is not None and used > machine.rt_runtime:
        flagged.append(
            CheckFinding(
                f"real-time processes may use {100 * machine.rt_runtime:.0f} % of the time "
                f"and a loop used {100 * used:.0f} %",
                "sysctl kernel.sched_rt_runtime_us=-1",
            )
        )
    return flagged


def _timer(seen: Measurements) -> list[CheckFinding]:
    flagged = []
    slack = max((loop.slack_ns or 0 for loop in seen.loops), default=0)
    # the slack of a real-time process is not used, whatever it says
    ordinary = any(note.startswith("no real-time priority") for x in seen.loops for note in x.notes)
    if ordinary and slack > SLACK_NS:
        flagged.append(
            CheckFinding(f"timers may be {slack / 1000:g} µs late (slack)", "real-time priority")
        )
    if seen.resolution_ns > 1000:
        flagged.append(
            CheckFinding(
                f"the clock moves in steps of {seen.resolution_ns / 1000:g} µs",
                "boot with highres=on",
            )
        )
    source = seen.machine.clocksource
    if source in ("hpet", "acpi_pm", "jiffies", "refined-jiffies"):
        flagged.append(CheckFinding(f"the clock source is {source}", "boot with clocksource=tsc"))
    return flagged


def _largest(values: "np.ndarray[tuple[int, ...], np.dtype[np.int64]]") -> float:
    return float(values.max()) / 1e3 if len(values) else 0.0


def _kib(limit: int | None) -> str:
    return "unlimited" if limit is None else f"{limit // 1024} KiB"
