"""Output of ``canroll bus`` for a log: its messages, and the effect of additional ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from canroll.errors import VerdictError
from plant_sim.can_bus.analysis import ResponseBound, worst_case_utilisation
from plant_sim.can_bus.delay_bounds import DelayBounds
from plant_sim.can_bus.recorded_load import Effect
from plant_sim.can_bus.simulation import Simulation
from plant_sim.can_bus.traffic.arrivals import EVENT, MIXED, PERIODIC, Arrivals
from plant_sim.can_bus.traffic.bit_rate import BitRate
from plant_sim.can_bus.traffic.inference import InferredBus
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import REMOTE

_MS = 1e-6
_MANY_TOO_CLOSE = 0.01


@dataclass(frozen=True, slots=True)
class RecordedAnswer:
    """Printed results of one channel of the log ``name``.

    ``added``: additional messages from ``source``; ``delay``: over two of them, or the missing
    bound; ``simulation``: of the added messages beside the recorded frames.
    """

    name: str
    bus: InferredBus
    source: str
    added: Sequence[BusMessage]
    effects: Sequence[Effect]
    path: tuple[str, str, float]
    delay: DelayBounds | ResponseBound | None
    simulation: Simulation | None

    @property
    def failed(self) -> bool:
        """Whether some message has no bound for a reason inherent to the bus."""
        bounds = [b for e in self.effects for b in (e.before, e.after) if b is not None]
        return any(b.bound_ns is None and b.covered for b in bounds)


def limit_ns(bound: ResponseBound, effect: Effect) -> int | None:
    """Return a bound as shown: from the nominal release, for events from their queueing."""
    periodic = effect.seen is None or effect.seen.arrivals.kind == PERIODIC
    return bound.bound_ns if periodic else bound.queued_ns


def check_added(answer: RecordedAnswer) -> None:
    """Reject a bound of an added message that its simulation beside the log exceeds.

    Raises:
        VerdictError: it does.
    """
    for effect in answer.effects:
        limit, seen = limit_ns(effect.after, effect), _simulated(answer, effect)
        if effect.seen is None and limit is not None and seen is not None and seen > limit:
            raise VerdictError(
                f"{effect.message.name}: simulated response {seen * _MS:.3f} ms above its bound"
                f" {limit * _MS:.3f} ms"
            )


def _simulated(answer: RecordedAnswer, effect: Effect) -> int | None:
    """Return the longest recorded or simulated response, ns."""
    if effect.seen is not None:
        return effect.seen.seen_ns or None
    if answer.simulation is None:
        return None
    responses = answer.simulation.responses[effect.message.name].responses
    return int(responses.max()) if len(responses) else None


def as_json(answer: RecordedAnswer) -> dict[str, Any]:
    """Return the object of one channel."""
    bus = answer.bus
    return {
        "bitrate": bus.rate.nominal,
        "data_bitrate": bus.rate.data,
        "bitrate_evidence": bus.rate.pairs,
        "assumed": list(bus.rate.assumed),
        "too_close": bus.rate.too_close,
        "duration_s": bus.recording.duration_s,
        "frames": len(bus.recording.frames.t_ns),
        "remote_frames": _remote(bus),
        "error_frames": bus.errors,
        "remarks": list(bus.warnings),
        "utilisation": {"before": _load(answer, ()), "after": _load(answer, answer.added)},
        "messages": {e.message.name: _message(answer, e) for e in answer.effects},
        "delay": _delay(answer.delay),
    }


def _message(answer: RecordedAnswer, effect: Effect) -> dict[str, Any]:
    seen, message = effect.seen, effect.message
    row: dict[str, Any] = {
        "id": message.ident,
        "added": seen is None,
        "period_ms": message.period_ns * _MS,
        "jitter_ms": message.jitter_ns * _MS,
        "bound_before_ms": None if effect.before is None else _bound(effect.before, effect),
        "bound_after_ms": _bound(effect.after, effect),
        "reason": effect.after.reason or None,
        "assumes": list(effect.assumes),
        "response_seen_ms": _milliseconds(_simulated(answer, effect)),
    }
    if seen is None:
        return row
    found = seen.arrivals
    evidence: dict[str, Any] = {
        "kind": found.kind,
        "cycle_ms": found.cycle * _MS or None,
        "offset_ms": found.offset * _MS if found.cycle else None,
        "distance_ms": found.distance * _MS or None,
        "lengths": list(seen.lengths),
        "frames": found.frames,
        "between": found.between,
        "missing": found.missing,
        "restarts": found.restarts,
        "exact": found.exact,
        "uncertainty_ms": found.uncertainty * _MS,
        "residual_ms": found.residual * _MS,
        "confidence": found.confidence,
    }
    return row | evidence


def _bound(bound: ResponseBound, effect: Effect) -> float | None:
    return _milliseconds(limit_ns(bound, effect))


def _milliseconds(value: int | None) -> float | None:
    return None if value is None else round(value * _MS, 6)


def _delay(delay: DelayBounds | ResponseBound | None) -> dict[str, float] | None:
    if not isinstance(delay, DelayBounds):
        return None
    seconds = {
        "tau_min_ms": delay.tau_min,
        "tau_max_ms": delay.tau_max,
        "age_bound_ms": delay.age_max,
    }
    return {key: value * 1e3 for key, value in seconds.items()}


def _load(answer: RecordedAnswer, added: Sequence[BusMessage]) -> float:
    rate = answer.bus.rate
    messages = [*(m.message for m in answer.bus.messages), *added]
    return worst_case_utilisation(messages, bitrate=rate.nominal, data_bitrate=rate.data)


def show(answer: RecordedAnswer) -> None:
    """Print the table of one channel and the lines below it."""
    console = Console()
    bus = answer.bus
    console.print(_rate_line(answer.name, bus), highlight=False)
    for warning in bus.warnings:
        console.print(f"warning: {warning}", highlight=False)
    console.print(_table(answer))
    for kind in (MIXED, EVENT):
        chosen = [m for m in bus.messages if m.arrivals.kind == kind]
        if chosen:
            told = ", ".join(f"{m.message.ident:X} ({_spread(m.arrivals)})" for m in chosen)
            console.print(f"{kind}: {told}", highlight=False)
    if any(e.assumes for e in answer.effects):
        console.print("* if those come no denser than recorded", highlight=False)
    reasons = [b for e in answer.effects for b in (e.before, e.after) if b and b.bound_ns is None]
    for reason in dict.fromkeys(b.reason for b in reasons):
        names = dict.fromkeys(f"{b.message.ident:X}" for b in reasons if b.reason == reason)
        which = (
            "all"
            if len(names) == len({e.message.ident for e in answer.effects})
            else ", ".join(names)
        )
        console.print(f"without a bound, {reason}: {which}", highlight=False)
    console.print(
        f"load with the longest frames {_load(answer, ()):.1%},"
        f" with {answer.source} {_load(answer, answer.added):.1%}",
        highlight=False,
    )
    if bus.errors:
        many = "s" if bus.errors > 1 else ""
        console.print(
            f"{bus.errors} error frame{many} in the log: allow for them by --error-interval"
        )
    if answer.delay is not None:
        console.print(_delay_line(answer), highlight=False)


def _spread(found: Arrivals) -> str:
    """Return the recorded spread of frames that are not, or not all, on a time grid."""
    if found.kind == MIXED:
        text = f"{found.between} of {found.frames} between the periodic ones"
        return text + (f", {found.restarts} restarts" if found.restarts else "")
    return f"{found.frames} frames"


def _remote(bus: InferredBus) -> int:
    """Return the number of remote frames in the log."""
    return int((bus.recording.frames.flags & REMOTE != 0).sum())


def _rate_line(name: str, bus: InferredBus) -> str:
    rate: BitRate = bus.rate
    text = f"{rate.nominal / 1000:g}" + (f" and {rate.data / 1000:g}" if rate.data else "")
    source = f"inferred from {rate.pairs} frames without a pause" if rate.pairs else "as given"
    source = "assumed" if rate.assumed else source
    remote = _remote(bus)
    apart = f" ({remote} of them remote)" if remote else ""
    line = (
        f"{name}, channel {bus.channel}: {len(bus.recording.frames.t_ns)} frames{apart} in"
        f" {bus.recording.duration_s:g} s at {text} kbit/s ({source})"
    )
    if rate.too_close > _MANY_TOO_CLOSE:
        line += (
            f"\n{rate.too_close:.1%} of the frames come sooner than that rate allows: the times"
            " of the log are those of a driver, or the rate is higher"
        )
    return line


def _table(answer: RecordedAnswer) -> Table:
    title = f"times in ms; after: the bound with {answer.source}"
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("message", no_wrap=True, max_width=14)
    for heading in ("bytes", "period", "jitter", "frames", "conf.", "seen", "bound", "after"):
        table.add_column(heading, justify="right", no_wrap=True)
    for effect in answer.effects:
        message, seen = effect.message, effect.seen
        star = "*" if effect.assumes else ""
        longest = _simulated(answer, effect)
        table.add_row(
            f"{message.ident:X}" + ("" if seen else f" {message.name}"),
            *_evidence(effect),
            "–" if longest is None else f"{longest * _MS:.3f}",
            "" if effect.before is None else _limit(effect.before, effect, star),
            _limit(effect.after, effect, star),
            style=None if seen else "bold",
        )
    return table


def _limit(bound: ResponseBound, effect: Effect, star: str) -> str:
    limit = limit_ns(bound, effect)
    return "none" if limit is None else f"{limit * _MS:.3f}{star}"


def _evidence(effect: Effect) -> tuple[str, ...]:
    """Cells from the length to the confidence."""
    message, seen = effect.message, effect.seen
    period, jitter = f"{message.period_ns * _MS:.5g}", f"{message.jitter_ns * _MS:.3f}"
    if seen is None:
        return f"{message.length}", period, jitter, "", ""
    found = seen.arrivals
    lengths = "/".join(map(str, seen.lengths)) if len(seen.lengths) < 3 else f"≤ {message.length}"
    frames = f"{found.frames}"
    if found.kind == PERIODIC:
        return lengths, period, jitter, frames, f"{found.confidence:.0%}"
    if found.kind == MIXED:
        return lengths, f"{found.cycle * _MS:.5g} +", "–", frames, "–"
    return lengths, f"≥ {found.distance * _MS:.3g}", "–", frames, "–"


def _delay_line(answer: RecordedAnswer) -> str:
    sensor, command, tick_ms = answer.path
    line = f"{sensor} to {command} at a tick of {tick_ms:g} ms on this bus: "
    if isinstance(answer.delay, DelayBounds):
        total = answer.delay
        return (
            f"{line}total delay {total.tau_min * 1e3:.2f} to {total.tau_max * 1e3:.2f} ms,"
            f" sample-to-force age at most {total.age_max * 1e3:.2f} ms"
        )
    assert answer.delay is not None
    return f"{line}no bound of the delay, {answer.delay.message.name}: {answer.delay.reason}"
