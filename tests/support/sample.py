"""Small programs of the subset, written to a folder."""

import textwrap
from pathlib import Path

STATE = '''
"""Records."""
from typing import Annotated
from canroll.firmware.subset import F, i32, record, u8

N = 3
MASK = 1 << 40


@record
class Ecu:
    """State."""

    # counters
    count: Annotated[i32, F(0, 100, 0, "", "count")]
    small: Annotated[u8, F(0, 9, 0, "", "digit")]
    x: Annotated[list[i32], N, F(-1000, 1000, 4, "m", "position")]
    m: Annotated[list[list[i32]], N, 2, F(-8, 8, 0, "", "matrix")]
    bytes: Annotated[list[u8], 8, F(0, 255, 0, "", "mailbox", True)]


@record
class Calibration:
    """Constants."""

    gain: Annotated[list[i32], N, F(-(1 << 24), 1 << 24, 0, "", "gain")]
    shift: Annotated[u8, F(1, 62, 0, "", "shift")]
    order: Annotated[u8, F(0, N, 0, "", "order")]
'''

HEAD = '''
"""Sample."""
from typing import Annotated
from canroll.firmware.state import N, MASK, Calibration, Ecu
from canroll.firmware.subset import to_i32, to_u32, u16, u32
from canroll.firmware.subset import I32_MAX, byte, clamp, clear, i32, i64, narrow, octet, rsh
from canroll.firmware.subset import sat31, sat32, scaled, tdiv, u8, word

TABLE: tuple[i32, ...] = (1, -2, 3)


'''


class Sample:
    """A folder with state.py and sample.py."""

    state, head = STATE, HEAD

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = path / "sample.py"

    def write(self, text: str) -> Path:
        """Write the program; return its folder."""
        (self.path / "state.py").write_text(STATE.lstrip("\n"))
        self.file.write_text(HEAD.lstrip("\n") + textwrap.dedent(text).lstrip("\n"))
        return self.path

    def line_of(self, part: str) -> int:
        """Number of the line in sample.py that holds ``part``."""
        lines = self.file.read_text().splitlines()
        return next(i for i, line in enumerate(lines, 1) if part in line)
