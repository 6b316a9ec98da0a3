"""What the ECU noticed of a run's faults, when, and what harm was done.

A run is harmful where roll angle or path error exceed the limits of :mod:`canroll.reaction.harm`,
where the actuators push the body to the wrong side, outwards in a curve, with more than 500 N·m for
more than 100 ms, or where the vehicle rolls over; where the run without faults is known, by more
than that does. A fault is detected where the ECU sets a new fault code or leaves ACTIVE, or where
the actuators release the command.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from canroll.firmware.state import ACTIVE
from canroll.plant_sim.faults import Fault
from canroll.plant_sim.world.spool import Table, pieces
from canroll.reaction.fault_codes import FAULT_CODES, MODES
from canroll.reaction.harm import LIMITS

WRONG_MOMENT = 500.0
"""Moment to the wrong side (N·m) that harms if it lasts for :data:`WRONG_TIME` (s)."""
WRONG_TIME = 0.1


class ObservedTrace(Protocol):
    """What is needed of the record of a run, as in :class:`canroll.runs.trace.Trace`."""

    @property
    def signals(self) -> Mapping[str, NDArray[np.float64]]:
        """The vehicle every millisecond, one array per signal."""

    @property
    def ticks(self) -> Table:
        """The ECU after every tick."""

    @property
    def duration(self) -> float:
        """Length of the run, s."""


@dataclass(frozen=True, slots=True)
class ModeChange:
    """The ECU's mode from ``t`` (s) on."""

    t: float
    mode: str


@dataclass(frozen=True, slots=True)
class CodeSeen:
    """A fault code: when it was first and last active (s), and in how many ticks."""

    code: int
    name: str
    first: float
    last: float
    ticks: int


@dataclass(frozen=True, slots=True)
class Harm:
    """One way in which a run was harmful, from ``t`` (s) on."""

    t: float
    text: str


@dataclass(frozen=True, slots=True)
class Reaction:
    """Reaction of a controlled run to its faults.

    Attributes:
        modes: every change of mode, the first one included.
        codes: every fault code that was active.
        wrong_side_max_nm: largest moment to the wrong side, N·m.
        wrong_side_s: longest time with more than 500 N·m to the wrong side without a break, s.
        start: when the first fault began; None without faults.
        detected_after: time from there to the detection; None if not detected.
        detected_by: what the detection was, such as "stuck" or "SAFE"; empty if there was none.
        mode: the mode that the ECU was in most after the detection, or after ``start``.
        harm: in which ways the run was harmful.
        harm_after: time from the first fault to the first harm; None without harm.
        no_verdict: why the run says nothing about its faults; empty if it does.
    """

    modes: tuple[ModeChange, ...]
    codes: tuple[CodeSeen, ...]
    wrong_side_max_nm: float
    wrong_side_s: float
    start: float | None
    detected_after: float | None
    detected_by: str
    mode: str
    harm: tuple[str, ...]
    harm_after: float | None
    no_verdict: str

    @property
    def undetected_harm(self) -> bool:
        """Whether harm was done and nothing detected."""
        return bool(self.harm) and self.detected_after is None

    @property
    def text(self) -> str:
        """Detection and harm in one line; empty without faults."""
        if self.start is None:
            return ""
        if self.no_verdict:
            return f"no verdict on the fault: {self.no_verdict}"
        detection = "fault not detected"
        if self.detected_after is not None:
            detection = (
                f"fault detected after {1e3 * self.detected_after:.0f} ms ({self.detected_by})"
            )
        return f"{detection}, {'; '.join(self.harm) if self.harm else 'no harm'}"

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        lists = {name: list(asdict(self)[name]) for name in ("modes", "codes", "harm")}
        return {**asdict(self), **lists}


def observe(
    trace: ObservedTrace,
    passive: ObservedTrace,
    faults: Sequence[Fault],
    healthy: ObservedTrace | None = None,
) -> Reaction:
    """Return the reaction of the ECU in ``trace`` to ``faults``.

    ``passive`` is the same manoeuvre with the passive vehicle and without faults. ``healthy`` is
    it with control and without faults: what harm that does is not the faults'.
    """
    start = min((fault.start for fault in faults), default=None)
    begin = 0.0 if start is None else start
    usual = None if healthy is None else _outwards(healthy)
    harms = sorted(_harms(trace, passive, healthy, usual, begin), key=lambda harm: harm.t)
    detection = None if start is None else _detection(trace, start)
    later = trace.ticks["mode"][trace.ticks["t"] >= (begin if detection is None else detection[0])]
    modes = np.bincount(later) if len(later) else np.zeros(1)
    no_verdict = ""
    if start is not None and start >= trace.duration:
        no_verdict = f"it begins at {start:g} s, the run ends at {trace.duration:g} s"
    wrong, longest, _ = _wrong_side(trace, begin, usual)
    return Reaction(
        modes=mode_changes(trace.ticks),
        codes=codes_seen(trace.ticks),
        wrong_side_max_nm=wrong,
        wrong_side_s=longest,
        start=start,
        detected_after=None if detection is None or start is None else detection[0] - start,
        detected_by="" if detection is None else detection[1],
        mode=MODES[int(np.argmax(modes))],
        harm=tuple(harm.text for harm in harms),
        harm_after=harms[0].t - begin if harms else None,
        no_verdict=no_verdict,
    )


def mode_changes(ticks: Table) -> tuple[ModeChange, ...]:
    """Return every change of mode in rows of :data:`canroll.runs.trace.TICK`, with the first."""
    time, mode = ticks["t"], ticks["mode"].astype(int)
    places = np.flatnonzero(np.diff(mode, prepend=-1))
    return tuple(ModeChange(float(time[i]), MODES[int(mode[i])]) for i in places)


def codes_seen(ticks: Table) -> tuple[CodeSeen, ...]:
    """Return every fault code active in rows of :data:`canroll.runs.trace.TICK`."""
    time, codes, seen = ticks["t"], ticks["fault_codes"], []
    for code, name in sorted(FAULT_CODES.items()):
        active = time[(codes >> code) & 1 == 1]
        if len(active):
            seen.append(CodeSeen(code, name, float(active[0]), float(active[-1]), len(active)))
    return tuple(seen)


def _detection(trace: ObservedTrace, start: float) -> tuple[float, str] | None:
    """Return when and by what the first fault was detected."""
    ticks = np.asarray(trace.ticks)
    before, after = ticks[ticks["t"] < start], ticks[ticks["t"] >= start]
    known = int(np.bitwise_or.reduce(before["fault_codes"][-1:], initial=0))
    events = []
    new = after["fault_codes"] & ~np.uint32(known)
    for place in np.flatnonzero(new)[:1]:
        names = [name for code, name in FAULT_CODES.items() if int(new[place]) >> code & 1]
        events.append((float(after["t"][place]), ", ".join(names)))
    was_active = len(before) == 0 or before["mode"][-1] == ACTIVE
    left = np.flatnonzero(after["mode"] != ACTIVE) if was_active and len(before) else ()
    for place in left[:1]:
        events.append((float(after["t"][place]), MODES[int(after["mode"][place])]))
    held = trace.signals["command_held"]
    time = trace.signals["time"]
    released = np.flatnonzero((time[1:] > start) & (held[1:] == 0) & (held[:-1] > 0))
    events += [(float(time[i + 1]), "command released") for i in released[:1]]
    return min(events, key=lambda entry: entry[0], default=None)


def _outwards(trace: ObservedTrace) -> NDArray[np.float64]:
    """Return the moment to the wrong side (N·m) of a whole run."""
    return np.concatenate(
        [
            (front + rear) * np.sign(ay)
            for front, rear, ay in pieces(trace.signals, "moment_front", "moment_rear", "ay")
        ]
    )


def _wrong_side(
    trace: ObservedTrace, begin: float, usual: NDArray[np.float64] | None
) -> tuple[float, float, float | None]:
    """Return the largest wrong moment, its longest time beyond the limit, and when it harms.

    ``usual`` is that of the run without faults; where it is beyond the limit, it is added to it.
    """
    most, harmful = 0.0, None
    longest, run, last, number = 0, 0, -2, 0
    for time, front, rear, ay in pieces(trace.signals, "time", "moment_front", "moment_rear", "ay"):
        outwards = np.where(time >= begin, (front + rear) * np.sign(ay), 0.0)
        most = max(most, float(outwards.max()))
        limit = np.full(len(outwards), WRONG_MOMENT)
        if usual is not None:
            own = usual[number : number + len(outwards)]
            limit[: len(own)] += np.where(own > WRONG_MOMENT, own, 0.0)
        for place in map(int, np.flatnonzero(outwards > limit)):
            run = run + 1 if number + place == last + 1 else 1
            last = number + place
            longest = max(longest, run)
            if harmful is None and run > 1e3 * WRONG_TIME:
                harmful = float(time[place])
        number += len(time)
    return most, longest * 1e-3, harmful


def _peak(trace: ObservedTrace, name: str, begin: float = -np.inf) -> float:
    """Return the largest absolute value of a signal from ``begin`` (s) on."""
    return max(
        (
            float(np.abs(values[time >= begin]).max(initial=0.0))
            for time, values in pieces(trace.signals, "time", name)
        ),
        default=0.0,
    )


def _first(trace: ObservedTrace, name: str, limit: float, begin: float = -np.inf) -> float | None:
    """Return when a signal's absolute value first exceeds ``limit`` from ``begin`` (s) on."""
    for time, values in pieces(trace.signals, "time", name):
        over = np.flatnonzero((np.abs(values) > limit) & (time >= begin))
        if len(over):
            return float(time[over[0]])
    return None


def _harms(
    trace: ObservedTrace,
    passive: ObservedTrace,
    healthy: ObservedTrace | None,
    usual: NDArray[np.float64] | None,
    begin: float,
) -> list[Harm]:
    harms = []
    others = [passive] if healthy is None else [passive, healthy]
    for limit in LIMITS:
        before = limit.scale * max(_peak(other, limit.signal) for other in others)
        over = _first(trace, limit.signal, float(limit.limit(before)) / limit.scale, begin)
        if over is not None and before > 0:
            most = limit.scale * _peak(trace, limit.signal, begin)
            text = f"{limit.label} {most:.2f}{limit.unit} instead of {before:.2f}{limit.unit}"
            harms.append(Harm(over, text))
    most, longest, harmful = _wrong_side(trace, begin, usual)
    if harmful is not None:
        text = f"up to {most:.0f} N·m on the wrong side for {longest:.2f} s"
        harms.append(Harm(harmful, text))
    rolls = _first(trace, "rollover", 0.0)
    if rolls is not None and all(_first(other, "rollover", 0.0) is None for other in others):
        harms.append(Harm(rolls, "the vehicle rolls over"))
    return harms
