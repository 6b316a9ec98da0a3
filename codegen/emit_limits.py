"""firmware/limits.py from the calibration's field table: the range check of every field.

``python -m codegen.emit_limits`` writes it; a test fails when it drifts from the table.
"""

from pathlib import Path

import firmware.calibration
from firmware.subset import I32_MAX, I32_MIN, Field, fields

PATH = Path(firmware.calibration.__file__).with_name("limits.py")

HEADER = '''\
"""Range check of the calibration, generated from its field table by codegen.emit_limits."""

from firmware.calibration import Calibration
from firmware.subset import i32


def outside(value: i32, low: i32, high: i32) -> i32:
    """Return 1 where ``value`` is not within [low, high]."""
    if value < low or value > high:
        return 1
    return 0


def check_ranges(cal: Calibration) -> i32:
    """Return 0, or the number of the first field that is out of its range, from 1."""
'''


def check_lines(number: int, field: Field) -> list[str]:
    """Return the source lines that check one field."""
    if (field.f.lo, field.f.hi) == (I32_MIN, I32_MAX):
        return []
    indices = "ijk"[: len(field.shape)]
    lines = [
        f"{'    ' * (depth + 1)}for {index} in range({size}):"
        for depth, (index, size) in enumerate(zip(indices, field.shape, strict=True))
    ]
    pad = "    " * (len(field.shape) + 1)
    place = f"cal.{field.name}" + "".join(f"[{index}]" for index in indices)
    lines.append(f"{pad}if outside({place}, {field.f.lo}, {field.f.hi}) == 1:")
    lines.append(f"{pad}    return {number}")
    return lines


def emit() -> str:
    """Return the source of firmware/limits.py."""
    lines = [HEADER.rstrip("\n")]
    for number, field in enumerate(fields(firmware.calibration.Calibration), start=1):
        lines += check_lines(number, field)
    return "\n".join([*lines, "    return 0", ""])


if __name__ == "__main__":
    PATH.write_text(emit(), encoding="utf-8")
