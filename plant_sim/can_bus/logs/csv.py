"""Tables of frames (``.csv``): of python-can, and of SavvyCAN and GVRET.

Source of the latter: framefileio.cpp of SavvyCAN; its times are whole microseconds.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import can

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.logs.lines import Line, LineError, Numbered, parsed
from canroll.plant_sim.can_bus.logs.remarks import Remarks

_OURS: Final = ("timestamp", "arbitration_id", "extended", "remote", "error", "dlc", "data")
_NEEDED: Final = ("time stamp", "id", "len")
_MOST_CLASSIC: Final = 8
WHAT: Final = "a row of these columns"
EXPECTED: Final = (
    f"{','.join(_OURS)} (python-can) or Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,…"
    " (SavvyCAN, GVRET)"
)


def read(lines: Sequence[Line], remarks: Remarks) -> list[Numbered]:
    """Return the frames of a table.

    Raises:
        LineError: a row cannot be read.
        CanrollError: it has other columns.
    """
    rows = [line for line in lines if line.text.strip()]
    if not rows:
        return []
    names = [name.strip().lower() for name in rows[0].text.split(",")]
    if tuple(names) == _OURS:
        messages = list(parsed(can.CSVReader, ((row, row.text) for row in rows), WHAT))
        for _, message in messages:
            # a format without a flag for it
            message.is_fd = message.dlc > _MOST_CLASSIC
        return messages
    if not set(_NEEDED) <= set(names):
        shown = rows[0].text.strip()[:60]
        raise CanrollError(f"columns '{shown}': expected are {EXPECTED}")
    return list(_savvycan(rows[1:], names))


def _savvycan(rows: Sequence[Line], names: Sequence[str]) -> Iterator[Numbered]:
    first = names.index("d1") if "d1" in names else len(names)
    for line in rows:
        cells = [cell.strip() for cell in line.text.split(",")]
        row = dict(zip(names, cells, strict=False))
        try:
            length = int(row["len"])
            data = bytes(int(cell, 16) for cell in cells[first : first + length] if cell)
            message = can.Message(
                timestamp=int(row["time stamp"]) * 1e-6,
                arbitration_id=int(row["id"], 16),
                is_extended_id=row.get("extended", "false").lower() in ("true", "1"),
                is_fd=length > _MOST_CLASSIC,
                is_rx=row.get("dir", "Rx").lower() != "tx",
                channel=int(row.get("bus", "0")),
                dlc=length,
                data=data,
            )
        except (ValueError, KeyError) as error:
            raise LineError(line, f"not {WHAT}") from error
        yield Numbered(line.number, message)
