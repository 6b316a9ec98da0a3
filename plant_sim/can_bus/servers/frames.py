"""Frames of the simulated buses as python-can messages."""

from typing import Any

import can

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.kernel.network import check_frame
from canroll.plant_sim.can_bus.servers.hub import PortFrame
from canroll.plant_sim.can_bus.traffic.log_reader import flags_of
from canroll.plant_sim.can_bus.wire.frame import (
    BIT_RATE_SWITCH,
    ERROR_FLAG,
    ERROR_STATE,
    EXTENDED,
    FD,
    RECESSIVE_INDICATOR,
    REMOTE,
)


def truth(value: Any) -> bool:  # noqa: ANN401
    """Return a boolean from an option of a configuration file or command line."""
    return str(value).strip().lower() in {"1", "true", "yes", "on"}


def sent_flags(message: can.Message, *, fd: bool, where: str) -> int:
    """Return the wire flags of a message to be sent.

    Raises:
        can.CanOperationError: it is not a valid CAN frame, or is FD on a node without FD.
    """
    if message.is_fd and not fd:
        raise can.CanOperationError(f"{where} has no FD: open it with fd=True")
    flags = flags_of(message) | (ERROR_FLAG if message.is_error_frame else 0)
    if message.is_fd and message.error_state_indicator:
        flags |= RECESSIVE_INDICATOR
    try:
        check_frame(message.arbitration_id, message.dlc, flags)
    except CanrollError as error:
        raise can.CanOperationError(f"{where}: {error}") from error
    return flags


def message_of(frame: PortFrame, channel: Any, node: int) -> can.Message:  # noqa: ANN401
    """Return a received frame as a python-can message for ``node``."""
    flags = frame.flags
    remote = bool(flags & REMOTE)
    return can.Message(
        timestamp=frame.time_s,
        arbitration_id=frame.ident,
        is_extended_id=bool(flags & EXTENDED),
        is_remote_frame=remote,
        is_error_frame=frame.error,
        dlc=frame.length,
        data=None if remote else frame.payload,
        is_fd=bool(flags & FD),
        bitrate_switch=bool(flags & BIT_RATE_SWITCH),
        error_state_indicator=bool(flags & ERROR_STATE),
        is_rx=frame.sender != node,
        channel=channel,
    )
