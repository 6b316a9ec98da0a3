"""Metrics of a run, what helps and what harms by them, and its bus and trigger figures.

A metric is a field of :class:`Metrics`: declared there, it is computed for every run and stands in
the JSON object, in the tables and in the columns of a campaign.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from canroll import dbc
from canroll.firmware.state import ACTIVE, DEGRADED
from canroll.plant_sim.bodies.ports import AXLES, WHEELS
from canroll.plant_sim.can_bus.kernel.layout import DELIVERED
from canroll.plant_sim.world.spool import blocks, pieces
from canroll.reaction.harm import PATH_ERROR, ROLL_ANGLE, HarmLimit
from canroll.runs.ride import SAMPLE, W_D, W_E, W_K, Weighting, weighted_rms
from canroll.runs.trace import Trace
from canroll.typing import Vector
from canroll.vehicles import Vehicle

MOMENTS = tuple(f"moment_{axle}" for axle in AXLES)
"""Anti-roll moments on the body from the actuators, by axle."""


POWERS = tuple(f"actuator_power_{axle}" for axle in AXLES)
"""Power that the actuators give to body and wheels, by axle."""


@dataclass(frozen=True, slots=True)
class Extent:
    """Smallest, mean and largest of a figure."""

    min: float
    mean: float
    max: float


@dataclass(frozen=True, slots=True)
class Can:
    """Bus figures: load of the ECU's segment, frames, response times and ages in ms."""

    load: float
    frames: int
    response_ms: dict[str, Extent]
    age_ms: Extent | None


@dataclass(frozen=True, slots=True)
class Trigger:
    """Numbers of commands and ticks. ``samples``: ticks with control active.

    ``transmission_rate`` includes heartbeats, ``transmission_rate_triggered`` does not; ``floor``
    is the rate of heartbeats alone: tick over heartbeat period.
    """

    samples: int
    sent: int
    heartbeats: int
    transmission_rate: float
    transmission_rate_triggered: float
    floor: float


def rms(values: Vector) -> float:
    """Root of the mean square; 0 without values."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


def peak(values: Vector) -> float:
    """Largest absolute value; 0 without values."""
    return float(np.max(np.abs(values))) if len(values) else 0.0


def load_transfer(left: Vector, right: Vector) -> Vector:
    """Normalised load transfer (F_right − F_left)/(F_right + F_left) of an axle; 0 in the air."""
    total = left + right
    return np.divide(right - left, total, out=np.zeros_like(total), where=total > 1.0)


def loads_of(axle: str) -> tuple[str, str]:
    """Return the signals of the left and the right wheel load of an axle."""
    return f"wheel_load_{axle}_left", f"wheel_load_{axle}_right"


def has_wheel_loads(trace: Trace) -> bool:
    """Whether the plant of a run has wheel loads; an FMU may have none."""
    return _has_loads(trace.signals, [f"wheel_load_{wheel}" for wheel in WHEELS])


def _has_loads(signals: Mapping[str, NDArray[np.float64]], names: Sequence[str]) -> bool:
    first = next(pieces(signals, *names), ())
    return not any(np.isnan(loads[0]) for loads in first)


def moment(trace: Trace) -> Vector:
    """Anti-roll moment on the body from the actuators, N·m, every millisecond."""
    front, rear = MOMENTS
    return trace.signals[front] + trace.signals[rear]


Signals = Mapping[str, NDArray[np.float64]]
Compute = Callable[[Signals, Sequence[str]], float | None]
"""Computes a metric from the signals of a run and the names of those that it needs."""


def _rms(signals: Signals, names: Sequence[str]) -> float:
    """Root of the mean square of the sum of the signals."""
    squares, count = 0.0, 0
    for parts in pieces(signals, *names):
        values = _sum(parts)
        squares += float(np.sum(np.square(values)))
        count += len(values)
    return math.sqrt(squares / count) if count else 0.0


def _max(signals: Signals, names: Sequence[str]) -> float:
    """Largest absolute value of the sum of the signals."""
    return max((peak(_sum(parts)) for parts in pieces(signals, *names)), default=0.0)


def _sum(parts: Sequence[Vector]) -> Vector:
    return parts[0] if len(parts) == 1 else np.sum(parts, axis=0)


def _degrees(compute: Callable[[Signals, Sequence[str]], float]) -> Compute:
    return lambda signals, names: math.degrees(compute(signals, names))


def _transfer_max(signals: Signals, names: Sequence[str]) -> float | None:
    """Largest normalised load transfer of the first two wheels; None without wheel loads."""
    if not _has_loads(signals, names):
        return None
    return max(
        (peak(load_transfer(*loads)) for loads in pieces(signals, *names[:2])),
        default=0.0,
    )


def _weighted(weighting: Weighting) -> Compute:
    """Frequency-weighted RMS of a signal; None if the plant does not have it."""

    def compute(signals: Signals, names: Sequence[str]) -> float | None:
        if not _has(signals, names):
            return None
        return weighted_rms(weighting, (part for (part,) in pieces(signals, *names)))

    return compute


def _power(
    reduce: Callable[[Vector], float], gather: Callable[[Sequence[float]], float]
) -> Compute:
    """A figure of the actuators' power, reduced over pieces of the run; None without travels."""

    def compute(signals: Signals, names: Sequence[str]) -> float | None:
        if not _has(signals, names):
            return None
        return float(gather([reduce(_sum(parts)) for parts in pieces(signals, *names)] or [0.0]))

    return compute


def _has(signals: Signals, names: Sequence[str]) -> bool:
    """Whether a run has signals; one of an older version or of an FMU may lack them."""
    return all(name in signals for name in names) and _has_loads(signals, names)


def _work(power: Vector) -> float:
    return float(np.sum(power)) * SAMPLE


def _ever(signals: Signals, names: Sequence[str]) -> bool:
    return any(np.any(piece > 0) for (piece,) in pieces(signals, *names))


@dataclass(frozen=True, slots=True)
class Metric:
    """A number of a run, or a fact about it.

    Attributes:
        key: its name in JSON objects and columns.
        fact: whether it is true or false instead of a number.
        label: its name in tables.
        unit: as printed; empty: none.
        digits: decimals in tables.
        signals: what it is computed from.
        compute: computes it; None if the plant does not have it.
        lowered: whether control is there to lower it; see :func:`helps`.
        paid: whether control that raises it by more than 5 % pays for less roll with it.
        harm: from where on it is harm; None: it is none.
    """

    key: str
    fact: bool
    label: str
    unit: str
    digits: int
    signals: tuple[str, ...]
    compute: Compute
    lowered: bool = False
    paid: bool = False
    harm: HarmLimit | None = None

    @property
    def title(self) -> str:
        """The label with the unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


def metric(
    label: str,
    unit: str,
    digits: int,
    signals: tuple[str, ...],
    compute: Compute,
    **others: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401
    """Return a field of :class:`Metrics`; arguments as in :class:`Metric`."""
    return field(
        metadata={
            "label": label,
            "unit": unit,
            "digits": digits,
            "signals": signals,
            "compute": compute,
            **others,
        }
    )


_ROLL, _RATE, _ERROR = ("roll",), ("roll_rate",), ("path_error",)
_FRONT, _REAR = (
    tuple(f"wheel_load_{wheel}" for wheel in WHEELS if wheel.startswith(axle)) for axle in AXLES
)


@dataclass(frozen=True, slots=True)
class Metrics:
    """Metrics of one run; the names carry the units.

    NLT: normalised load transfer, 0 to 1; None if the plant has no wheel loads.
    """

    roll_rms_deg: float = metric("roll angle RMS", "deg", 2, _ROLL, _degrees(_rms), lowered=True)
    roll_max_deg: float = metric(
        "roll angle max", "deg", 2, _ROLL, _degrees(_max), lowered=True, harm=ROLL_ANGLE
    )
    roll_rate_rms_deg_s: float = metric(
        "roll rate RMS", "deg/s", 2, _RATE, _degrees(_rms), paid=True
    )
    roll_rate_max_deg_s: float = metric(
        "roll rate max", "deg/s", 2, _RATE, _degrees(_max), paid=True
    )
    nlt_front_max: float | None = metric("NLT front max", "", 3, (*_FRONT, *_REAR), _transfer_max)
    nlt_rear_max: float | None = metric("NLT rear max", "", 3, (*_REAR, *_FRONT), _transfer_max)
    moment_rms_nm: float = metric("moment RMS", "N·m", 0, MOMENTS, _rms)
    moment_max_nm: float = metric("moment max", "N·m", 0, MOMENTS, _max)
    path_error_rms_m: float = metric("path error RMS", "m", 3, _ERROR, _rms)
    path_error_max_m: float = metric("path error max", "m", 3, _ERROR, _max, harm=PATH_ERROR)
    ride_vertical_ms2: float | None = metric(
        "ride vertical", "m/s²", 3, ("heave_acc",), _weighted(W_K)
    )
    ride_lateral_ms2: float | None = metric(
        "ride lateral", "m/s²", 3, ("sprung_ay",), _weighted(W_D)
    )
    ride_roll_rads2: float | None = metric("ride roll", "rad/s²", 3, ("roll_acc",), _weighted(W_E))
    actuator_work_j: float | None = metric("actuator work", "J", 0, POWERS, _power(_work, sum))
    actuator_power_max_w: float | None = metric(
        "actuator power max", "W", 0, POWERS, _power(peak, max)
    )
    rollover: bool = metric("rollover", "", 0, ("rollover",), _ever)


METRICS: tuple[Metric, ...] = tuple(
    Metric(entry.name, entry.type is bool, **entry.metadata) for entry in fields(Metrics)
)
"""The metrics in the order of tables."""
NUMBERS = tuple(each for each in METRICS if not each.fact)
BY_KEY: Mapping[str, Metric] = {each.key: each for each in METRICS}
LEAST_ROLL_DEG = 0.01
"""Below this largest roll angle there is no roll to reduce."""


def judge(trace: Trace) -> Metrics:
    """Return the metrics of one run over its whole length."""
    return Metrics(**{each.key: each.compute(trace.signals, each.signals) for each in METRICS})  # type: ignore[arg-type]


Values = Mapping[str, Any]
"""Metrics of one run, or of many as arrays, by their keys."""


def helps(passive: Values, controlled: Values, oscillates: ArrayLike) -> NDArray[np.bool_]:
    """Return whether control helps: it prevents a rollover, or lowers what it is there to lower.

    It does not where the vehicle rolls over, oscillates in a limit cycle, or does not roll anyway.
    """
    lowered = [controlled[each.key] < passive[each.key] for each in METRICS if each.lowered]
    over, under = (np.asarray(side["rollover"], bool) for side in (controlled, passive))
    rolls = np.asarray(passive["roll_max_deg"]) >= LEAST_ROLL_DEG
    helpful = under | np.logical_and.reduce(lowered)
    return np.asarray(~over & ~np.asarray(oscillates, bool) & rolls & helpful, bool)


def harm(passive: Values, controlled: Values) -> NDArray[np.float64]:
    """Return how close control is to harm: at least 1 where it does harm.

    Of the metrics that can be harm the largest, over the limit from the run without control; a
    rollover that only control has is harm too. Limits as in :mod:`canroll.reaction.harm`.
    """
    levels = [
        each.harm.level(np.asarray(passive[each.key]), np.asarray(controlled[each.key]))
        for each in METRICS
        if each.harm is not None
    ]
    over, under = (np.asarray(side["rollover"], bool) for side in (controlled, passive))
    return np.maximum(np.maximum.reduce(levels), np.where(over & ~under, 1.0, 0.0))


def load_transfer_without_roll(
    trace: Trace, vehicle: Vehicle, front_share: float
) -> dict[str, float | None]:
    """Return the peak load transfer with the body upright.

    The wheels must carry m h a_y + m g h φ; roll control can remove only the second part, from the
    body leaning over its wheels. Based on the wheel loads of the passive run: the moment of springs
    and dampers of each axle is replaced by that axle's share of the moment −m h a_y. This requires
    all wheels on a level road: on a bank or with a wheel in the air the figures are None.

    Args:
        trace: of the passive run.
        vehicle: vehicle of the plant.
        front_share: front axle's share of the actuators' moment.
    """
    plant, geometry, suspension = vehicle.plant, vehicle.geometry, vehicle.suspension
    signals = trace.signals
    if not has_wheel_loads(trace):
        return {f"nlt_{axle}_max": None for axle in AXLES}
    wheels = pieces(signals, *(f"wheel_load_{wheel}" for wheel in WHEELS))
    lifted = any(np.any(load <= 0) for loads in wheels for load in loads)
    if lifted or any(np.any(bank) for (bank,) in pieces(signals, "bank")):
        return {f"nlt_{axle}_max": None for axle in AXLES}
    axles = (
        (front_share, suspension.roll_stiffness_front_share, suspension.roll_damping_front_share),
        (
            1 - front_share,
            1 - suspension.roll_stiffness_front_share,
            1 - suspension.roll_damping_front_share,
        ),
    )
    tracks = (geometry.half_track_front, geometry.half_track_rear)
    figures: dict[str, float | None] = {}
    for axle, (share, stiffness, damping), track in zip(AXLES, axles, tracks, strict=True):
        figure = 0.0
        for ay, roll, rate, left, right in pieces(
            signals, "ay", "roll", "roll_rate", *loads_of(axle)
        ):
            sprung = stiffness * plant.roll_stiffness * roll + damping * plant.roll_damping * rate
            less = (sprung - share * (plant.roll_arm * ay)) / track
            figure = max(figure, peak(load_transfer(left + less / 2, right - less / 2)))
        figures[f"nlt_{axle}_max"] = min(1.0, figure)
    return figures


def response_times(trace: Trace, names: Mapping[int, str] | None = None) -> dict[str, Vector]:
    """Response times of the contract's messages, ms, from the queue to the end of the frame.

    A frame counts once on every segment it crosses. ``names``: names of the frames by identifier,
    if they are not the contract's.
    """
    if names is None:
        names = {message.frame_id: message.name for message in dbc.load().messages}
    parts: dict[int, list[Vector]] = {}
    for block in blocks(trace.frames):
        done = block[block["outcome"] == DELIVERED]
        for ident in map(int, np.unique(done["ident"])):
            if ident in names:
                of = done[done["ident"] == ident]
                parts.setdefault(ident, []).append((of["t_end"] - of["t_queued"]) * 1e-6)
    return {names[ident]: np.concatenate(parts[ident]) for ident in sorted(parts)}


def spread(values: Vector) -> Extent:
    """Return smallest, mean and largest; ``values`` is not empty."""
    return Extent(float(np.min(values)), float(np.mean(values)), float(np.max(values)))


def bus_load(trace: Trace) -> float:
    """Share of the run in which the first segment was busy with frames and interframe spaces."""
    busy_ns = 0
    for block in blocks(trace.frames):
        on = block[(block["segment"] == 0) & (block["t_start"] >= 0)]
        busy_ns += int(np.sum(on["t_end"] - on["t_start"]))
    return busy_ns * 1e-9 / trace.duration


def can(trace: Trace, names: Mapping[int, str] | None = None) -> Can:
    """Return the bus figures of a run; ``names`` as of :func:`response_times`."""
    delivered = trace.frames["outcome"] == DELIVERED
    return Can(
        load=bus_load(trace),
        frames=int(np.sum(delivered)),
        response_ms={name: spread(values) for name, values in response_times(trace, names).items()},
        age_ms=spread(np.asarray(trace.ages * 1e-6, dtype=np.float64)) if len(trace.ages) else None,
    )


def trigger(trace: Trace, *, heartbeat_ticks: int) -> Trigger:
    """Return the transmission figures of commands while control was active."""
    active = np.isin(trace.ticks["mode"], (ACTIVE, DEGRADED))
    why = trace.ticks["triggered"][active]
    samples, sent, beats = len(why), int(np.sum(why > 0)), int(np.sum(why == 2))
    return Trigger(
        samples=samples,
        sent=sent,
        heartbeats=beats,
        transmission_rate=sent / samples if samples else 0.0,
        transmission_rate_triggered=(sent - beats) / samples if samples else 0.0,
        floor=1 / heartbeat_ticks if heartbeat_ticks else 0.0,
    )
