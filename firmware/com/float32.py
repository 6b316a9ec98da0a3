"""Signals that are IEEE 754 floating-point numbers of 32 bits, in integers.

``factor`` / 2**``shift`` is what one of the number's units is in the field's integers, or the
inverse where a field is sent; ``factor`` has 30 bits, 2**29 <= abs(factor) <= 2**30. Products are
exact and rounded once. Only buses that have such signals have this module.
"""

from canroll.firmware.subset import clamp, i32, i64, rsh

FRACTION = 1 << 23
EXPONENT = 255 << 23
SIGN = 1 << 31


def fixed_of(code: i32, factor: i32, shift: i32) -> i64:
    """Return the number with the bits ``code`` times factor / 2**shift, rounded to nearest.

    Subnormal numbers give 0, those of 2**32 and above a value beyond 32 bits, infinities and what
    is not a number any value: the caller asks for them.
    """
    mantissa: i32 = (code & (FRACTION - 1)) | FRACTION
    if code < 0:
        mantissa = -mantissa
    # the product has 53 to 55 bits: at 20 it is beyond any field, at 62 below half of one step
    return rsh(mantissa * factor, clamp(150 + shift - ((code & EXPONENT) >> 23), 20, 62))


def code_of(value: i32, factor: i32, shift: i32) -> i32:
    """Return the bits of the number nearest to value factor / 2**shift, halves away from zero."""
    if value == 0:
        return 0
    size: i64 = value * factor
    sign: i32 = 0
    if size < 0:
        size = -size
        sign = -SIGN
    bits: i32 = 30
    left: i64 = size >> 30
    for _ in range(32):
        if left > 0:
            left = left >> 1
            bits += 1
    mantissa: i32 = clamp(rsh(size, bits - 24), 0, 2 * FRACTION)
    # a mantissa that is rounded up to 25 bits carries into the exponent
    return sign + (clamp(bits + 125 - shift, 0, 253) << 23) + mantissa
