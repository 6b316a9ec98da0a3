"""Intervals of integers: possible values of a firmware expression."""

from dataclasses import dataclass

KINDS = {
    "i32": (-(2**31), 2**31 - 1),
    "i64": (-(2**63), 2**63 - 1),
    "u8": (0, 255),
    "u16": (0, 2**16 - 1),
    "u32": (0, 2**32 - 1),
}
"""Least and largest number of each kind."""
BITS_31 = (-(2**30), 2**30 - 1)


@dataclass(frozen=True, slots=True)
class Value:
    """All integers from ``lo`` to ``hi``."""

    lo: int
    hi: int

    def __str__(self) -> str:
        return f"[{self.lo}, {self.hi}]"

    def within(self, lo: int, hi: int) -> bool:
        """Whether every integer of the value lies in [lo, hi]."""
        return lo <= self.lo and self.hi <= hi

    def limited(self, lo: int, hi: int) -> "Value":
        """The value intersected with [lo, hi]; the nearer end where it lies outside."""
        if self.within(lo, hi):
            return self
        return Value(min(max(self.lo, lo), hi), max(min(self.hi, hi), lo))


def hull(a: Value, b: Value) -> Value:
    """The smallest interval that contains both: one of the two where it contains the other."""
    if a.lo <= b.lo and b.hi <= a.hi:
        return a
    if b.lo <= a.lo and a.hi <= b.hi:
        return b
    return Value(min(a.lo, b.lo), max(a.hi, b.hi))


def add(a: Value, b: Value) -> Value:
    """a + b."""
    return Value(a.lo + b.lo, a.hi + b.hi)


def negate(a: Value) -> Value:
    """-a."""
    return Value(-a.hi, -a.lo)


def multiply(a: Value, b: Value) -> Value:
    """a * b."""
    corners = (a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi)
    return Value(min(corners), max(corners))


def bitwise(operator: str, a: Value, b: Value) -> Value:
    """a & b, a | b or a ^ b, in two's complement of unlimited width."""
    if operator == "&" and (a.lo >= 0 or b.lo >= 0):
        limits = [v.hi for v in (a, b) if v.lo >= 0]
        return Value(0, min(limits))
    if a.lo >= 0 and b.lo >= 0:
        top = (1 << max(a.hi, b.hi).bit_length()) - 1
        return Value(max(a.lo, b.lo) if operator == "|" else 0, top)
    bits = max(_width(a), _width(b))
    return Value(-(1 << bits), (1 << bits) - 1)


def _width(a: Value) -> int:
    return max(
        (~a.lo if a.lo < 0 else a.lo).bit_length(), (~a.hi if a.hi < 0 else a.hi).bit_length()
    )


def clamp(v: Value, lo: Value, hi: Value) -> Value:
    """clamp(v, lo, hi); where the bounds may cross, either can result."""
    low, high = max(v.lo, lo.lo), min(v.hi, hi.hi)
    if v.hi > hi.lo:
        low = min(low, hi.lo)
    if v.lo < lo.hi:
        high = max(high, lo.hi)
    return Value(low, high)


def shift_rounded(v: Value, n: Value) -> Value:
    """rsh(v, n) for counts in 1 … 62."""
    counts = (max(n.lo, 1), min(max(n.hi, 1), 62))
    ends = [(end + (1 << (k - 1))) >> k for end in (v.lo, v.hi) for k in counts]
    if v.lo <= 0 <= v.hi:
        ends.append(0)
    # (v + half) >> n is monotonic in v, and for each sign of v in n but for the rounding of one
    return Value(min(ends) - (n.lo != n.hi), max(ends) + (n.lo != n.hi))


def absolute(v: Value) -> Value:
    """absolute(v)."""
    return Value(max(v.lo, -v.hi, 0), max(v.hi, -v.lo))


def divide(a: Value, b: Value) -> Value:
    """tdiv(a, b) for nonzero divisors."""
    ends: list[int] = []
    divisors = {d for d in (b.lo, b.hi, -1, 1) if b.lo <= d <= b.hi and d}
    for top in (a.lo, a.hi):
        for d in divisors:
            q = abs(top) // abs(d)
            ends.append(-q if (top < 0) != (d < 0) else q)
    if not ends:
        return Value(0, 0)
    if a.lo <= 0 <= a.hi:
        ends.append(0)
    return Value(min(ends), max(ends))
