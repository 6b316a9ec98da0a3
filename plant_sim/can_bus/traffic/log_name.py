"""Name of a log as a bus: ``file#channel@bitrate/data_bitrate``, all but the file optional."""

import re
from pathlib import Path
from typing import Final, NamedTuple

from plant_sim.can_bus.traffic.log_reader import is_log

_RATES: Final = re.compile(r"@(?P<bitrate>\d+)(?:/(?P<data>\d+))?(?=#|$)")


class LogName(NamedTuple):
    """What a name says; None: not stated, and to be inferred."""

    path: Path
    channel: str | None
    bitrate: int | None
    data_bitrate: int | None


def log_name(text: str) -> LogName | None:
    """Return what the name of a log says, None if it is not that of a log."""
    rates = _RATES.search(text)
    file, mark, channel = _RATES.sub("", text, count=1).partition("#")
    path = Path(file)
    if not is_log(path):
        return None
    return LogName(
        path,
        channel if mark else None,
        int(rates["bitrate"]) if rates else None,
        int(rates["data"]) if rates and rates["data"] else None,
    )
