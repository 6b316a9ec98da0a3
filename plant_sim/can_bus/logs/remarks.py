"""Remarks of a reader: what it left out of a log and where, one line for each reason."""

from canroll.plant_sim.can_bus.logs.lines import Numbered
from canroll.plant_sim.can_bus.wire.frame import FD_LENGTHS

_MOST_CLASSIC = 8
_STANDARD = 0x7FF


class Remarks:
    """Remarks on one log.

    Args:
        unit: what is counted in it, "line" or "frame".
    """

    def __init__(self, unit: str = "line") -> None:
        self._unit = unit
        self._places: dict[str, list[int]] = {}

    def leave_out(self, reason: str, number: int) -> None:
        """Add that a line or frame is left out."""
        self._places.setdefault(f"{reason}: left out", []).append(number)

    def add(self, text: str) -> None:
        """Add a remark on the log as such."""
        self._places.setdefault(text, [])

    def texts(self) -> tuple[str, ...]:
        """Return one line for each reason, with the first place."""
        return tuple(self._text(reason, places) for reason, places in self._places.items())

    def _text(self, reason: str, places: list[int]) -> str:
        if not places:
            return reason
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        return f"{self._unit} {places[0]}{more}: {reason}"


def possible(messages: list[Numbered], remarks: Remarks) -> list[Numbered]:
    """Return the messages that can have been on a bus; the others are remarked."""
    kept = []
    for entry in messages:
        fault = _fault(entry)
        if fault:
            remarks.leave_out(fault, entry.number)
        else:
            kept.append(entry)
    return kept


def _fault(entry: Numbered) -> str:
    message = entry.message
    if message.is_error_frame:
        return ""
    if message.arbitration_id > _STANDARD and not message.is_extended_id:
        return f"identifier {message.arbitration_id:X} of a frame with 11 bits"
    if message.is_remote_frame:
        return ""
    size = len(message.data or b"")
    if not message.is_fd and size > _MOST_CLASSIC:
        return f"{size} bytes in a classic frame"
    if message.is_fd and message.dlc not in FD_LENGTHS:
        return f"{message.dlc} bytes in an FD frame"
    length = message.dlc if message.is_fd else min(message.dlc, _MOST_CLASSIC)
    return f"{size} of {length} bytes" if size < length else ""
