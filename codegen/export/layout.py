"""Where the tests of a bundle find a byte of a record: their data are those of a little-endian one.

A machine of the other byte order has the bytes of each word in turn; the rest is the same.
"""

from itertools import groupby
from typing import Any

from codegen.run import memory_image
from firmware.calibration import Calibration
from firmware.subset import fields

NAME = "test/layout.h"
TEXT = """\
/* Where a record has the byte that a little-endian machine has at a place: the data of the tests
   are of such a one. On a big-endian machine the bytes of each word have the opposite order. */
#ifndef LAYOUT_H
#define LAYOUT_H

#include <stddef.h>
#include <stdint.h>

/* Ends of stretches of words and of bytes in turn, the first of words. */
#define LAYOUT_ECU {{ {ecu} }}
#define LAYOUT_CALIBRATION {{ {calibration} }}

static inline int layout_big_endian(void)
{{
    const uint16_t one = 1u;
    return *(const uint8_t *)&one == 0u;
}}

static inline size_t layout_place(const size_t *ends, size_t at)
{{
    size_t stretch = 0u;
    while (at >= ends[stretch]) {{
        stretch++;
    }}
    return ((stretch & 1u) == 0u && layout_big_endian()) ? (at ^ 3u) : at;
}}

#endif
"""


def header(state: Any) -> str:  # noqa: ANN401
    """Return the text of ``test/layout.h`` for the class of a state record."""
    ends = {"ecu": state, "calibration": Calibration}
    lists = {name: ", ".join(f"{end}u" for end in _ends(its)) for name, its in ends.items()}
    return TEXT.format(**lists)


def _ends(record: Any) -> list[int]:  # noqa: ANN401
    """Where stretches of words and of bytes end, in turn, the first of words; padding is bytes."""
    offsets: Any = memory_image.dtype(record).fields
    ends = []
    words = True
    for kind, stretch in groupby(fields(record), key=lambda field: field.kind):
        if (kind == "i32") != words:
            ends.append(int(offsets[next(stretch).name][1]))
            words = not words
    return [*ends, memory_image.dtype(record).itemsize]
