"""Figures of a run: roll, load transfer, moment, bus and trigger figures."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import dbc
from canroll.typing import Vector
from firmware.state import ACTIVE, DEGRADED
from hil.runs.trace import Trace
from plant_sim.bodies.ports import AXLES, WHEELS
from plant_sim.can_bus.kernel.layout import DELIVERED
from plant_sim.world.spool import blocks, pieces
from vehicles import Vehicle

MOMENTS = tuple(f"moment_{axle}" for axle in AXLES)
"""Anti-roll moments on the body from the actuators, by axle."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """Figures of one run; the names carry the units.

    ``nlt``: normalised load transfer, 0 to 1; None if the plant has no wheel loads.
    """

    roll_rms_deg: float
    roll_max_deg: float
    roll_rate_rms_deg_s: float
    roll_rate_max_deg_s: float
    nlt_front_max: float | None
    nlt_rear_max: float | None
    moment_rms_nm: float
    moment_max_nm: float
    path_error_rms_m: float
    path_error_max_m: float
    rollover: bool


@dataclass(frozen=True, slots=True)
class Spread:
    """Smallest, mean and largest of a figure."""

    min: float
    mean: float
    max: float


@dataclass(frozen=True, slots=True)
class Can:
    """Bus figures: load of the ECU's segment, frames, response times and ages in ms."""

    load: float
    frames: int
    response_ms: dict[str, Spread]
    age_ms: Spread | None


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


def axle_load_transfer(trace: Trace, axle: str) -> Vector:
    """Normalised load transfer of an axle ("front" or "rear") over time."""
    left, right = loads_of(axle)
    return load_transfer(trace.signals[left], trace.signals[right])


def loads_of(axle: str) -> tuple[str, str]:
    """Return the signals of the left and the right wheel load of an axle."""
    return f"wheel_load_{axle}_left", f"wheel_load_{axle}_right"


def has_wheel_loads(trace: Trace) -> bool:
    """Whether the plant of a run has wheel loads; an FMU may have none."""
    first = next(pieces(trace.signals, *(f"wheel_load_{wheel}" for wheel in WHEELS)), ())
    return not any(np.isnan(loads[0]) for loads in first)


def _peak_load_transfer(trace: Trace, axle: str) -> float | None:
    if not has_wheel_loads(trace):
        return None
    return max(
        (peak(load_transfer(*loads)) for loads in pieces(trace.signals, *loads_of(axle))),
        default=0.0,
    )


def moment(trace: Trace) -> Vector:
    """Anti-roll moment on the body from the actuators, N·m, every millisecond."""
    front, rear = MOMENTS
    return trace.signals[front] + trace.signals[rear]


def _size(trace: Trace, *names: str) -> tuple[float, float]:
    """Root of the mean square and largest absolute value of the sum of signals."""
    squares, largest, count = 0.0, 0.0, 0
    for parts in pieces(trace.signals, *names):
        values = parts[0] if len(parts) == 1 else np.sum(parts, axis=0)
        squares += float(np.sum(np.square(values)))
        largest, count = max(largest, peak(values)), count + len(values)
    return math.sqrt(squares / count) if count else 0.0, largest


def judge(trace: Trace) -> Metrics:
    """Return the figures of one run over its whole length."""
    (roll_rms, roll_max), (rate_rms, rate_max) = _size(trace, "roll"), _size(trace, "roll_rate")
    moment_rms, moment_max = _size(trace, *MOMENTS)
    error_rms, error_max = _size(trace, "path_error")
    return Metrics(
        roll_rms_deg=math.degrees(roll_rms),
        roll_max_deg=math.degrees(roll_max),
        roll_rate_rms_deg_s=math.degrees(rate_rms),
        roll_rate_max_deg_s=math.degrees(rate_max),
        nlt_front_max=_peak_load_transfer(trace, "front"),
        nlt_rear_max=_peak_load_transfer(trace, "rear"),
        moment_rms_nm=moment_rms,
        moment_max_nm=moment_max,
        path_error_rms_m=error_rms,
        path_error_max_m=error_max,
        rollover=any(np.any(piece > 0) for (piece,) in pieces(trace.signals, "rollover")),
    )


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
    found: dict[int, list[Vector]] = {}
    for block in blocks(trace.frames):
        done = block[block["outcome"] == DELIVERED]
        for ident in map(int, np.unique(done["ident"])):
            if ident in names:
                of = done[done["ident"] == ident]
                found.setdefault(ident, []).append((of["t_end"] - of["t_queued"]) * 1e-6)
    return {names[ident]: np.concatenate(found[ident]) for ident in sorted(found)}


def spread(values: Vector) -> Spread:
    """Return smallest, mean and largest; ``values`` is not empty."""
    return Spread(float(np.min(values)), float(np.mean(values)), float(np.max(values)))


def bus_load(trace: Trace, segment: int = 0) -> float:
    """Share of the run in which ``segment`` was busy with frames and interframe spaces."""
    busy_ns = 0
    for block in blocks(trace.frames):
        on = block[(block["segment"] == segment) & (block["t_start"] >= 0)]
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
