"""Record the project's files that a process opens or imports: it is first on ``PYTHONPATH``.

Python imports this module at its start. Each path is appended to the file ``$CANROLL_RECORD``, as
are those of the processes that it forks or starts. A module counts by its source, wherever its
code is read from.
"""

import os
import sys
from pathlib import Path
from typing import Any

ROOT = str(Path(__file__).resolve().parents[2]) + os.sep
RECORD = os.environ["CANROLL_RECORD"]
_known: set[object] = {RECORD}


def _path_of(event: str, arguments: tuple[Any, ...]) -> object:
    """Return what an audit event opens or executes; the code of a module names its source."""
    if event == "exec":
        return getattr(arguments[0], "co_filename", None)
    return arguments[0] if event in ("open", "cpython.run_file") else None


def _record(event: str, arguments: tuple[Any, ...]) -> None:
    path = _path_of(event, arguments)
    if not isinstance(path, str | bytes) or path in _known:
        return
    text = os.fsdecode(path)
    if os.path.isabs(text):
        _known.add(path)  # a relative one depends on the folder
    real = os.path.realpath(text)
    if real.startswith(ROOT):
        number = os.open(RECORD, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(number, f"{real}\n".encode())
        os.close(number)


sys.addaudithook(_record)
