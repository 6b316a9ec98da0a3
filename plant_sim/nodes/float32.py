"""Floating-point numbers of 32 bits (IEEE 754) from and to their bits, in kernels."""

import math

from canroll.plant_sim.kernels.jit import njit

NOT_A_NUMBER = 0x7FC00000
_FRACTION = 1 << 23
_EXPONENT = 255 << 23


@njit
def finite(code: int) -> bool:
    """Whether the 32 bits ``code``, signed, are those of a number."""
    return code & _EXPONENT != _EXPONENT


@njit
def number_of(code: int) -> float:
    """The number with the bits ``code``, subnormal ones as 0; nan where they are not finite."""
    if not finite(code):
        return math.nan
    exponent = (code & _EXPONENT) >> 23
    if exponent == 0:
        return 0.0
    size = float((code & (_FRACTION - 1)) | _FRACTION) * 2.0 ** (exponent - 150)
    return -size if code < 0 else size


@njit
def code_of(value: float) -> int:
    """The bits, signed, of the number nearest to a ``value`` within the range of 32 bits."""
    size, exponent = abs(value), 127
    if size < 2.0**-126:
        return 0
    while size >= 2.0:
        size, exponent = 0.5 * size, exponent + 1
    while size < 1.0:
        size, exponent = 2.0 * size, exponent - 1
    # a mantissa that is rounded up to 2**24 carries into the exponent
    code: int = ((exponent - 1) << 23) + math.floor(size * _FRACTION + 0.5)
    return code - (1 << 31) if value < 0.0 else code
