"""Settings of a Linux machine that affect real-time loops, read from /proc and /sys.

A file that is missing or cannot be read gives None (unknown), never a guess.
"""

import os
import resource
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

HERTZ = os.sysconf("SC_CLK_TCK")
"""Units of /proc/stat a second."""
_BUSY = (0, 1, 2, 5, 6)
"""Columns of /proc/stat in which a core works: user, nice, system, irq, softirq."""
_STEAL = 7


@dataclass(frozen=True, slots=True)
class Core:
    """Settings of one core.

    Attributes:
        isolated: excluded from scheduling (isolcpus).
        governor: frequency governor; None if unknown.
        idle_state: deepest enabled idle state; None without one.
        idle_exit_us: exit latency of that state, µs.
    """

    number: int
    isolated: bool
    governor: str | None = None
    idle_state: str | None = None
    idle_exit_us: int = 0


@dataclass(frozen=True, slots=True)
class HostMachine:
    """Settings of the whole machine.

    Attributes:
        cores: cores available to this process.
        kernel: release and build.
        realtime_kernel: PREEMPT_RT, by /sys/kernel/realtime.
        hypervisor: the kernel runs in a virtual machine, by the processor's flags.
        clocksource: clock source of the kernel.
        rt_runtime: share of the time available to real-time processes; 1: all.
        quota: processor time of the control group, in cores; None: not limited.
        rtprio_limit: highest SCHED_FIFO priority without root (``ulimit -r``).
        memlock_limit: lockable bytes without root (``ulimit -l``); None: unlimited.
    """

    cores: tuple[Core, ...]
    kernel: str
    realtime_kernel: bool
    hypervisor: bool
    clocksource: str | None
    rt_runtime: float | None
    quota: float | None
    rtprio_limit: int
    memlock_limit: int | None


@dataclass(frozen=True, slots=True)
class Counters:
    """Counters of /proc and the control group since boot: s by core, and times throttled."""

    busy: dict[int, float]
    steal: dict[int, float]
    throttled: int

    def since(self, before: "Counters") -> "Counters":
        """Return the increments since ``before``."""
        return Counters(
            {core: value - before.busy.get(core, 0.0) for core, value in self.busy.items()},
            {core: value - before.steal.get(core, 0.0) for core, value in self.steal.items()},
            self.throttled - before.throttled,
        )


def read(numbers: Iterable[int], root: Path = Path("/")) -> HostMachine:
    """Read the settings of the machine and its cores; ``root`` contains /proc and /sys."""
    isolated = core_list(_text(root / "sys/devices/system/cpu/isolated") or "")
    runtime = _number(root / "proc/sys/kernel/sched_rt_runtime_us")
    period = _number(root / "proc/sys/kernel/sched_rt_period_us")
    share = None
    if runtime is not None and period:
        share = 1.0 if runtime < 0 else runtime / period
    name = os.uname()
    flags = _text(root / "proc/cpuinfo") or ""
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return HostMachine(
        cores=tuple(_core(root, number, number in isolated) for number in numbers),
        kernel=f"{name.release} {name.version}",
        realtime_kernel=_text(root / "sys/kernel/realtime") == "1",
        hypervisor=any("hypervisor" in x.split() for x in flags.splitlines() if "flags" in x),
        clocksource=_text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource"),
        rt_runtime=share,
        quota=_quota(root),
        rtprio_limit=_limit(resource.RLIMIT_RTPRIO),
        memlock_limit=None if locked == resource.RLIM_INFINITY else locked,
    )


def counters(root: Path = Path("/")) -> Counters:
    """Read the counters."""
    busy, steal = {}, {}
    for line in (_text(root / "proc/stat") or "").splitlines():
        name, *rest = line.split()
        if name.startswith("cpu") and name[3:].isdigit():
            values = [int(value) / HERTZ for value in rest]
            busy[int(name[3:])] = sum(values[k] for k in _BUSY)
            steal[int(name[3:])] = values[_STEAL] if len(values) > _STEAL else 0.0
    throttled = 0
    for folder in _control_groups(root):
        for line in (_text(folder / "cpu.stat") or "").splitlines():
            if line.startswith("nr_throttled "):
                throttled += int(line.split()[1])
    return Counters(busy, steal, throttled)


def core_list(text: str) -> set[int]:
    """Return the cores of a list such as "1,4-6"; none for an empty one."""
    cores: set[int] = set()
    for part in text.strip().split(","):
        first, _, last = part.partition("-")
        if first.isdigit():
            cores.update(range(int(first), int(last or first) + 1))
    return cores


def _core(root: Path, number: int, isolated: bool) -> Core:
    folder = root / f"sys/devices/system/cpu/cpu{number}"
    states = []
    for state in sorted((folder / "cpuidle").glob("state*")):
        exit_us = _number(state / "latency")
        if exit_us is not None and not _number(state / "disable"):
            states.append((exit_us, _text(state / "name") or state.name))
    exit_us, name = max(states, default=(0, None))
    return Core(number, isolated, _text(folder / "cpufreq/scaling_governor"), name, exit_us)


def _quota(root: Path) -> float | None:
    """Return the smallest limit on processor time among this process's control groups, in cores."""
    quotas = []
    for folder in _control_groups(root):
        words = (_text(folder / "cpu.max") or "").split()
        if len(words) == 2 and words[0] != "max":
            quotas.append(int(words[0]) / int(words[1]))
        quota, period = (_number(folder / f"cpu.cfs_{name}_us") for name in ("quota", "period"))
        if quota is not None and period and quota > 0:
            quotas.append(quota / period)
    return min(quotas, default=None)


def _control_groups(root: Path) -> list[Path]:
    """Return the folders of the control groups of this process, version 2 or 1."""
    folders = []
    for line in (_text(root / "proc/self/cgroup") or "").splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers:
            base = root / "sys/fs/cgroup"
        elif "cpu" in controllers.split(","):
            base = root / "sys/fs/cgroup" / controllers
        else:
            continue
        own = base / path.strip("/")
        folders += [own, *(p for p in own.parents if p == base or base in p.parents)]
    return folders


def _limit(kind: int) -> int:
    soft = resource.getrlimit(kind)[0]
    return 99 if soft == resource.RLIM_INFINITY else soft


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None


def _number(path: Path) -> int | None:
    text = _text(path)
    try:
        return None if text is None else int(text)
    except ValueError:
        return None
