"""The JSON objects of ``canroll bus``: one row writer, with the keys of each kind of network."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from canroll.network.answer import MS, Answer, MessageRow, PathDelay, SegmentAnswer, Times
from canroll.plant_sim.can_bus.traffic.inference import InferredMessage

Keys = Mapping[str, Callable[[MessageRow], Any]]


def milliseconds(value: float | None) -> float | None:
    """Return nanoseconds in milliseconds, None if there is no value."""
    return None if value is None or math.isnan(value) else round(value * MS, 6)


def _simulated(what: str, times: Callable[[MessageRow], Times]) -> Keys:
    """Return the keys of simulated times."""
    return {
        f"{what}_min_ms": lambda row: milliseconds(times(row).least),
        f"{what}_mean_ms": lambda row: milliseconds(times(row).mean),
        f"{what}_max_ms": lambda row: milliseconds(times(row).greatest),
    }


SIMULATED_RESPONSE = _simulated("response", lambda row: row.response)
SIMULATED_ARRIVAL = _simulated("arrival", lambda row: row.arrival)
RESPONSE: Keys = {
    "response_bound_ms": lambda row: milliseconds(row.bound.bound_ns),
    **SIMULATED_RESPONSE,
}
"""Of a message of a traffic set."""
ON_SEGMENT: Keys = {
    "name": lambda row: row.message.name,
    "id": lambda row: row.message.ident,
    "sender": lambda row: row.message.sender,
    "jitter_ms": lambda row: row.message.jitter_ns * MS,
    **RESPONSE,
    "way": lambda row: list(row.way),
    "arrival_bound_ms": lambda row: milliseconds(row.arrival_ns),
    **SIMULATED_ARRIVAL,
    "reason": lambda row: row.bound.reason or None,
}
"""Of a message on a segment of a network."""
RECORDED: Keys = {
    "id": lambda row: row.message.ident,
    "added": lambda row: row.evidence is None,
    "period_ms": lambda row: row.message.period_ns * MS,
    "jitter_ms": lambda row: row.message.jitter_ns * MS,
    "bound_before_ms": lambda row: row.before and milliseconds(row.limit_ns(row.before)),
    "bound_after_ms": lambda row: milliseconds(row.limit_ns(row.bound)),
    "reason": lambda row: row.bound.reason or None,
    "assumes": lambda row: list(row.assumes),
    "response_seen_ms": lambda row: milliseconds(row.longest_ns),
}
"""Of a message on a recorded bus."""
TAU = ("tau_min_ms", "tau_max_ms", "age_bound_ms")
"""Keys of the bounds of a delay."""


def _values(row: MessageRow, keys: Keys) -> dict[str, Any]:
    return {key: value(row) for key, value in keys.items()}


def set_json(answer: Answer) -> dict[str, Any]:
    """Return the object of a traffic set: its messages by name."""
    (segment,) = answer.segments
    return {
        "utilisation": segment.utilisation,
        "messages": {row.message.name: _values(row, RESPONSE) for row in segment.rows},
        **answer.facts,
        **_load(segment),
        **({} if answer.delay is None else {"delay": _delay(answer.delay)}),
    }


def network_json(answer: Answer) -> dict[str, Any]:
    """Return the object of a network: its segments by name, with their messages in a list."""
    return {
        "segments": {segment.name: _segment(segment) for segment in answer.segments},
        "delay": None if answer.delay is None else _delay(answer.delay),
    }


def _segment(segment: SegmentAnswer) -> dict[str, Any]:
    unused = {*SIMULATED_RESPONSE, *SIMULATED_ARRIVAL} if segment.load is None else ()
    keys = {key: value for key, value in ON_SEGMENT.items() if key not in unused}
    return {
        "bitrate": segment.bitrate,
        "data_bitrate": segment.data_bitrate,
        "utilisation": segment.utilisation,
        "messages": [_values(row, keys) for row in segment.rows],
        **_load(segment),
    }


def _load(segment: SegmentAnswer) -> dict[str, float]:
    return {} if segment.load is None else {"simulated_load": segment.load}


def log_json(answer: Answer) -> dict[str, Any]:
    """Return the object of a channel of a log: its messages by name, with their evidence."""
    (segment,) = answer.segments
    delay = None if answer.delay is None or answer.delay.bounds is None else _delay(answer.delay)
    return {
        **answer.facts,
        "bitrate": segment.bitrate,
        "data_bitrate": segment.data_bitrate,
        "utilisation": {"before": segment.utilisation_before, "after": segment.utilisation},
        "messages": {
            row.message.name: _values(row, RECORDED) | _evidence(row.evidence)
            for row in segment.rows
        },
        "delay": delay and {key: delay[key] for key in TAU},
    }


def _evidence(recorded: InferredMessage | None) -> dict[str, Any]:
    if recorded is None:
        return {}
    return {
        "kind": "event-driven" if recorded.assumed else "periodic",
        "distance_ms": recorded.message.distance_ns * MS or None,
        "lengths": list(recorded.lengths),
        "frames": recorded.frames,
    }


def _delay(delay: PathDelay) -> dict[str, float | None]:
    bounds = delay.bounds
    seconds = (None,) * 3 if bounds is None else (bounds.tau_min, bounds.tau_max, bounds.age_max)
    return {
        **{key: s and s * 1e3 for key, s in zip(TAU, seconds, strict=True)},
        "age_min_ms": milliseconds(delay.age.least),
        "age_max_ms": milliseconds(delay.age.greatest),
    }
