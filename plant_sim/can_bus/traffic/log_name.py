"""Name of a log as a bus: ``file#channel@bitrate/data_bitrate``, all but the file optional."""

import re
from pathlib import Path
from typing import Final, NamedTuple

from canroll.plant_sim.buses import LOGS, PACKED

_RATES: Final = re.compile(r"@(?P<bitrate>\d+)(?:/(?P<data>\d+))?(?=#|$)")


def is_log(path: Path) -> bool:
    """Return whether a path has the suffix of a bus log."""
    return suffix_of(path) in LOGS


def suffix_of(path: Path) -> str:
    """Return the suffix of a log in lower case, that below gzip's if it has one."""
    suffix = path.suffix.lower()
    return Path(path.stem).suffix.lower() if suffix == PACKED else suffix


class LogName(NamedTuple):
    """What a name says; None: not stated."""

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
