"""Safety envelope of the actuator node: rejects commands that contradict the measured motion.

The node takes the lateral acceleration from the Imu's frames, with a separate receiver; where the
yaw rate in them turns to the other side, no direction is known, and none is judged. A command
that pushes the body outward for too long while the acceleration does not fall is not followed until
it has stopped, nor is any once the acceleration has not been heard for long. Limits of moment and
rate are the actuator's own (:func:`canroll.plant_sim.nodes.actuator_models.refer`).
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import codec, codec_tables, e2e
from canroll.plant_sim.nodes.codec import Codec
from canroll.typing import Vector

OUTWARD_SHARE = 0.2
"""Share of an axle's largest roll moment that may point outward for any time."""
JUDGED_ABOVE = 2.0
"""Lateral acceleration above which a direction is judged, m/s²."""
FALLEN = 0.25
"""Difference to the low-passed acceleration at which it falls, m/s²."""
LOW_PASS = 0.16
"""Its time constant, s."""
PATIENCE_MS = 200
DEAF_NS = 500_000_000
"""Longest time outward, and longest time without an acceleration once one has been heard."""

NEVER = -1.0

ENVELOPE = np.dtype(
    [
        *fields("f8", "arm", 2, 4),
        *fields("f8", "most", 2),
        *fields("i8", "frame message signal yaw_rate"),
        *fields("f8", "acceleration slow outward_ms cut acted heard_ns turning"),
        ("receiver", e2e.RECEIVER),
    ]
)
"""``arm`` makes moments by axle of commands by channel, ``most`` limits them, N·m.

``frame`` to ``yaw_rate``: rows of frame, message, lateral acceleration and yaw rate in the codec's
tables, -1 where it is not on the bus, or not in that frame; then its state, and the E2E state of
the Imu's frames.
"""
Envelope: TypeAlias = Any


def build(
    arm: tuple[tuple[float, ...], tuple[float, ...]],
    most: tuple[float, float],
    tables: Codec,
    supervision: e2e.Supervision,
) -> Envelope:
    """Envelope that has heard nothing yet."""
    signal = codec_tables.signal_index("Imu", "LateralAcceleration")
    message = int(tables.field[signal]["frame"])
    row = tables.message[message]
    yaw_rate = codec_tables.signal_index("Imu", "YawRate")
    field = tables.field[yaw_rate]
    together = field["pieces"] and field["frame"] == message
    result = np.zeros(1, ENVELOPE)[0]
    result["arm"], result["most"] = arm, most
    result["frame"] = int(row["leader"]) if row["length"] else -1
    result["message"], result["signal"] = message, signal
    result["yaw_rate"] = yaw_rate if together else -1
    result["heard_ns"] = NEVER
    result["receiver"] = e2e.receiver_state(supervision)
    return result


@njit
def hear(
    envelope: Envelope,
    tables: Codec,
    supervision: e2e.Supervision,
    payload: NDArray[np.uint8],
    t_ns: int,
) -> None:
    """Take acceleration and yaw rate from a frame of the Imu, if it is valid and in sequence."""
    message, signal = envelope.message, envelope.signal
    status = e2e.check(
        envelope.receiver,
        supervision,
        tables.protection[message],
        payload,
    )
    raw = codec.extract(tables, signal, payload)
    if status > e2e.INITIAL or not codec.valid(tables, signal, raw):
        return
    envelope.acceleration = codec.physical(tables, signal, raw)
    envelope.heard_ns = t_ns
    envelope.turning = 0.0
    yaw_rate = envelope.yaw_rate
    if yaw_rate >= 0:
        raw = codec.extract(tables, yaw_rate, payload)
        if codec.valid(tables, yaw_rate, raw):
            envelope.turning = codec.physical(tables, yaw_rate, raw)


@njit
def side_of_curve(envelope: Envelope) -> float:
    """Return the sign of the acceleration, 0 where the yaw rate has the other one."""
    if envelope.acceleration * envelope.turning < 0.0:
        return 0.0
    return 1.0 if envelope.acceleration > 0.0 else -1.0


@njit
def cuts(envelope: Envelope, front: float, rear: float, t_ns: int) -> bool:
    """Judge the roll moments (N·m) wanted for the next millisecond; whether to refuse them.

    Axle by axle: one that pushes outward is not made good by the other.
    """
    if envelope.heard_ns == NEVER:
        return False
    acceleration = envelope.acceleration
    side = side_of_curve(envelope)
    limit_front, limit_rear = OUTWARD_SHARE * envelope.most[0], OUTWARD_SHARE * envelope.most[1]
    outward = side * front > limit_front or side * rear > limit_rear
    steady = side * (acceleration - envelope.slow) > -FALLEN
    envelope.slow += (acceleration - envelope.slow) * 1e-3 / LOW_PASS
    if outward and steady and side * acceleration > JUDGED_ABOVE:
        envelope.outward_ms = min(envelope.outward_ms + 1.0, PATIENCE_MS)
    else:
        envelope.outward_ms = max(envelope.outward_ms - 1.0, 0.0)
    if envelope.outward_ms == PATIENCE_MS:
        envelope.cut = 1.0
    elif envelope.outward_ms == 0.0:
        envelope.cut = 0.0
    refused = (envelope.cut == 1.0 and outward) or t_ns - envelope.heard_ns > DEAF_NS
    envelope.acted = 1.0 if refused else 0.0
    return bool(refused)


@njit
def outward(envelope: Envelope, moment: float, t_ns: int) -> bool:
    """Whether a roll moment (N·m) pushes outward in the curve that was heard of lately."""
    known = envelope.heard_ns != NEVER and t_ns - envelope.heard_ns <= DEAF_NS
    return bool(known and moment * side_of_curve(envelope) > 0.0)


@njit
def moment_of(envelope: Envelope, axle: int, commands: Vector) -> float:
    """Roll moment (N·m) of commands by channel at an axle."""
    total = 0.0
    for channel in range(4):
        total += envelope.arm[axle, channel] * commands[channel]
    return total
