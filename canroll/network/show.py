"""Terminal output of ``canroll bus``: a table for each segment, and lines below."""

import math
from collections.abc import Callable, Iterator, Sequence

from rich import box
from rich.table import Table

from canroll.network.answer import MS, Answer, LoopNames, MessageRow, PathDelay, SegmentAnswer
from canroll.plant_sim.can_bus.bounds.analysis import ResponseBound

Column = tuple[str, Callable[[MessageRow], str]]


def _time(value: float | None, nothing: str = "–") -> str:
    """Return nanoseconds in ms."""
    return nothing if value is None or math.isnan(value) else f"{value * MS:.3f}"


def _limit(row: MessageRow, bound: ResponseBound | None) -> str:
    """Return a bound in ms, with a star if it depends on the frequency of recorded events."""
    if bound is None:
        return ""
    limit = row.limit_ns(bound)
    return "none" if limit is None else _time(limit) + ("*" if row.assumes else "")


def _period(row: MessageRow) -> str:
    if row.evidence is None or not row.evidence.assumed:
        return f"{row.message.period_ns * MS:.5g}"
    return f"≥ {row.message.distance_ns * MS:.3g}"


def _jitter(row: MessageRow) -> str:
    on_events = row.evidence is not None and row.evidence.assumed
    return "–" if on_events else f"{row.message.jitter_ns * MS:.3f}"


def _recorded_name(row: MessageRow) -> str:
    return f"{row.message.ident:X}" + ("" if row.evidence else f" {row.message.name}")


def _lengths(row: MessageRow) -> str:
    lengths = row.evidence.lengths if row.evidence else (row.message.length,)
    return "/".join(map(str, lengths)) if len(lengths) < 3 else f"≤ {row.message.length}"


def _frames(row: MessageRow) -> str:
    return f"{row.evidence.frames}" if row.evidence else ""


ON_SEGMENT: Sequence[Column] = (
    ("message", lambda row: row.message.name),
    ("id", lambda row: f"{row.message.ident:X}"),
    ("period", _period),
    ("jitter", _jitter),
    ("bound", lambda row: _limit(row, row.bound)),
    ("min", lambda row: _time(row.response.least)),
    ("mean", lambda row: _time(row.response.mean)),
    ("99 %", lambda row: _time(row.response.most)),
    ("max", lambda row: _time(row.response.greatest)),
)
RECORDED: Sequence[Column] = (
    ("message", _recorded_name),
    ("bytes", _lengths),
    ("period", _period),
    ("jitter", _jitter),
    ("frames", _frames),
    ("seen", lambda row: _time(row.longest_ns)),
    ("bound", lambda row: _limit(row, row.before)),
    ("after", lambda row: _limit(row, row.bound)),
)
OVER_GATEWAYS: Sequence[Column] = (
    ("message", lambda row: row.message.name),
    ("way", lambda row: " → ".join(row.way)),
    ("bound", lambda row: _time(row.arrival_ns, "none")),
    ("min", lambda row: _time(row.arrival.least)),
    ("mean", lambda row: _time(row.arrival.mean)),
    ("99 %", lambda row: _time(row.arrival.most)),
    ("max", lambda row: _time(row.arrival.greatest)),
)


def parts(answer: Answer) -> Iterator[Table | str]:
    """Yield the tables and lines of an answer, in order."""
    if answer.head:
        yield answer.head
    for warning in answer.warnings:
        yield f"warning: {warning}"
    for segment in answer.segments:
        yield _segment_table(answer, segment)
        yield _load_line(answer, segment)
    forwarded = [row for _, row in answer.rows() if len(row.way) > 1]
    if forwarded:
        forwarded.sort(key=lambda row: row.message.arbitration_key)
        yield _table(
            "over gateways, from queueing by the first sender, ms", OVER_GATEWAYS, forwarded
        )
    yield from _without_bound(answer)
    late = [
        f"{name} ({_time(row.arrival_ns)} of {row.message.deadline_ns * MS:g} ms)"
        for name, row in answer.rows()
        if row.is_late
    ]
    if late:
        yield f"deadline missed: {', '.join(late)}"
    yield from answer.notes
    if answer.delay is not None:
        yield _delay_line(answer.delay, answer.loop)


def _table(title: str, columns: Sequence[Column], rows: Sequence[MessageRow]) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading, _ in columns:
        # on a narrow terminal only names are broken
        if heading in ("message", "way"):
            table.add_column(heading, overflow="fold")
        else:
            table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        added = row.evidence is None and any(other.evidence for other in rows)
        table.add_row(*(text(row) for _, text in columns), style="bold" if added else None)
    return table


def _segment_table(answer: Answer, segment: SegmentAnswer) -> Table:
    if answer.added:
        title = f"times in ms; after: the bound with {answer.added}"
        return _table(title, RECORDED, segment.rows)
    where = f", segment {segment.name}" if len(answer.segments) > 1 else ""
    title = f"{answer.name}{where} at {segment.kilobits} kbit/s: response times, ms"
    return _table(title, ON_SEGMENT, segment.rows)


def _load_line(answer: Answer, segment: SegmentAnswer) -> str:
    line = f"load with the longest frames {segment.utilisation:.1%}"
    if answer.added:
        line = (
            f"load with the longest frames {segment.utilisation_before:.1%},"
            f" with {answer.added} {segment.utilisation:.1%}"
        )
    if segment.load is None:
        return line
    return f"{line}, simulated {segment.load:.1%} ({segment.frames} frames)"


def _without_bound(answer: Answer) -> Iterator[str]:
    """Yield a line for every reason, with the messages that have no bound for it."""
    names: dict[str, list[str]] = {}
    for name, row in answer.rows():
        for bound in row.bounds:
            if bound.bound_ns is None and name not in names.setdefault(bound.reason, []):
                names[bound.reason].append(name)
    count = len({name for name, _ in answer.rows()})
    for reason, without in names.items():
        which = "all messages" if len(without) == count > 1 else ", ".join(without)
        yield f"without a bound, {reason}: {which}"


def _delay_line(delay: PathDelay, loop: LoopNames) -> str:
    """Return the line on the total delay from sensor to command."""
    line = f"{loop.sensor} to {loop.command} at a tick of {loop.tick_ms:g} ms: "
    seen = (
        ""
        if math.isnan(delay.age.least)
        else (f"simulated {delay.age.least * MS:.2f} to {delay.age.greatest * MS:.2f} ms")
    )
    if delay.bounds is None:
        line += f"no bound of the delay, {delay.reason}"
        return f"{line}; sample-to-force age {seen}" if seen else line
    total = delay.bounds
    line += (
        f"total delay {total.tau_min * 1e3:.2f} to {total.tau_max * 1e3:.2f} ms,"
        f" sample-to-force age at most {total.age_max * 1e3:.2f} ms"
    )
    return f"{line}, {seen}" if seen else line
