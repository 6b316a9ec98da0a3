"""Fault codes and modes of the ECU in words."""

from canroll import dbc
from canroll.firmware import plausibility
from canroll.firmware.com.signals import RX_IDS
from canroll.firmware.state import N_FAULT_CODES

FAULT_CODES = {
    **{
        place: f"{dbc.load().get_message_by_frame_id(ident).name} late"
        for place, ident in enumerate(RX_IDS)
    },
    **{
        number: name.removeprefix("FAULT_").replace("_", " ").lower()
        for name, number in vars(plausibility).items()
        if name.startswith("FAULT_") and isinstance(number, int)
    },
}
"""Fault codes in words."""
MODES = dbc.names("RollControlStatus", "Mode")
"""Modes by number."""


def in_words(bits: int | None) -> list[str]:
    """Return the fault codes of a bit field; none of None."""
    if bits is None:
        return []
    return [FAULT_CODES.get(i, f"code {i}") for i in range(N_FAULT_CODES) if int(bits) >> i & 1]
