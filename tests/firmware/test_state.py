"""The size of the state record, as a C compiler lays it out."""

import math

from canroll.codegen.run import memory_image
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import fields

WORD = 4


def bare(record):
    return sum(
        (WORD if field.kind == "i32" else 1) * math.prod(field.shape) for field in fields(record)
    )


def test_the_state_fits_two_kilobytes():
    assert memory_image.dtype(Ecu).itemsize <= 2048


def test_nothing_is_lost_to_padding_but_at_the_end():
    assert memory_image.dtype(Ecu).itemsize == math.ceil(bare(Ecu) / WORD) * WORD


def test_no_byte_of_the_calibration_is_padding():
    """Its CRC is that of the memory, and nothing says what padding holds."""
    assert memory_image.dtype(Calibration).itemsize == bare(Calibration)
