"""Random programs of the subset: loops, two records of a class, arrays, signs, calls with effects.

Not every one keeps the rules or can be proved; what is drawn stays small when hypothesis shrinks.
"""

from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

HEAD = '''"""A random program."""
from typing import Annotated
from canroll.firmware.subset import F, absolute, byte, clamp, i32, i64, narrow, record, rsh
from canroll.firmware.subset import sat31, sat32, scaled, tdiv, to_i32, to_u32, u8, u32


@record
class S:
    """State; no statement writes the guard."""

    n: Annotated[i32, F(-100, 100, 0, "", "")]
    w: Annotated[i32, F(-(1 << 31), (1 << 31) - 1, 0, "", "")]
    b: Annotated[u8, F(0, 9, 0, "", "")]
    a: Annotated[list[i32], 4, F(-1000, 1000, 0, "", "")]
    c: Annotated[list[u8], 4, F(0, 255, 0, "", "")]
    guard: Annotated[u8, F(0, 1, 0, "", "")]


def peek(s: S, k: i32) -> i32:
    """Read."""
    if k > 1 and k < 4:
        return s.a[k]
    return s.b


def poke(s: S, k: i32) -> i32:
    """Write."""
    s.b = byte(clamp(k, 0, 9))
    s.a[s.b & 3] = clamp(k, -1000, 1000)
    return s.b & 3


def fill(p: Annotated[list[u8], 4], k: i32) -> i32:
    """Write."""
    p[k & 3] = byte(k)
    return p[0] & 3


def tick(one: S, two: S, p: Annotated[list[u8], 4], u: i32, v: i32) -> i32:
    """Do."""
'''
RANGES = {"n": (-100, 100), "w": (-(1 << 31), (1 << 31) - 1), "b": (0, 9)}
ELEMENTS = {"one.a": (-1000, 1000), "two.a": (-1000, 1000), "one.c": (0, 255), "p": (0, 255)}
LITERALS = [0, 1, -1, 2, 3, 7, 100, 255, 256, 1000, 65535, 1 << 20, 1 << 30, (1 << 31) - 1, -128]
COUNTS = ["1", "2", "7", "8", "15", "31", "32", "33"]
WIDEST = 4
"""Rounds of a short loop, and deepest of the expressions."""


class Writer:
    """Writes one function; ``draw`` is that of hypothesis."""

    def __init__(self, draw: Callable[..., Any]) -> None:
        self.draw = draw
        self.lines: list[str] = []
        self.names = [("u", "i32"), ("v", "i32")]
        self.counters: list[str] = []
        self.indent, self.made = 1, 0

    def pick(self, *options: str) -> str:
        chosen: str = self.draw(st.sampled_from(options))
        return chosen

    def put(self, text: str) -> None:
        self.lines.append("    " * self.indent + text)

    def fresh(self, prefix: str) -> str:
        self.made += 1
        return f"{prefix}{self.made}"

    def block(self, depth: int) -> None:
        """One to three statements deeper."""
        self.indent += 1
        names = list(self.names)
        for _ in range(self.draw(st.integers(1, 3))):
            self.statement(depth)
        self.names = names
        self.indent -= 1

    # expressions

    def record(self) -> str:
        return self.pick("one", "two")

    def index(self, depth: int) -> str:
        plain = [str(k) for k in range(4)] + self.counters
        plain += [name for name, kind in self.names if kind in ("i32", "u8")]
        given = self.pick(*plain, "bits", "clamp", "field")
        if given == "bits":
            return f"{self.number(depth)} & 3"
        if given == "clamp":
            return f"clamp({self.number(depth)}, 0, 3)"
        return f"{self.record()}.b" if given == "field" else given

    def place(self, depth: int) -> tuple[str, tuple[int, int]]:
        """An element or a field, and the range that is declared of it."""
        array = self.pick("", *ELEMENTS)
        if array:
            return f"{array}[{self.index(depth)}]", ELEMENTS[array]
        field = self.pick(*RANGES)
        return f"{self.record()}.{field}", RANGES[field]

    def leaf(self) -> str:
        given = self.pick("literal", "name", "place", "counter")
        if given == "counter" and self.counters:
            return self.pick(*self.counters)
        if given == "place":
            return self.place(0)[0]
        return self.pick(*(name for name, _ in self.names)) if given == "name" else self.literal()

    def literal(self) -> str:
        number: int = self.draw(st.sampled_from(LITERALS))
        return f"({number})" if number < 0 else str(number)

    def number(self, depth: int) -> str:
        if depth <= 0:
            return self.leaf()
        a, b = self.number(depth - 1), self.number(depth - 2)
        count = self.pick(*COUNTS)
        return self.pick(
            a,
            f"({a} {self.pick('+', '-', '*', '&', '|', '^')} {b})",
            f"({a} >> {count})",
            f"({a} << {count})",
            f"(-{a})",
            f"rsh({a}, {count})",
            f"scaled({a}, {count})",
            f"absolute({a})",
            f"tdiv({a}, {self.pick('3', '-7', f'(({b} & 7) + 1)')})",
            f"clamp({a}, {self.pick('-5', '0', '-100')}, {self.pick('3', '9', '100000')})",
            f"byte({a})",
            f"sat31({a})",
            f"to_u32(sat32({a}))",
            f"to_i32(to_u32(sat32({a})) & {self.pick('255', '0x7FFFFFFF', '0xFFFFFFFF')})",
            f"peek({self.record()}, {self.pick('u', '2', 'v')})",
        )

    def limited(self, low: int, high: int) -> str:
        """A number for a place of a range, mostly one that keeps it."""
        number = self.number(self.draw(st.integers(0, WIDEST - 1)))
        low, high = max(low, -(1 << 31)), min(high, (1 << 31) - 1)
        limits = [f"clamp({number}, {low}, {high})"] * 3
        return self.pick(*limits, self.effect(f"{low}, {high}"), number)

    def effect(self, limits: str) -> str:
        """A call that writes, alone or beside what may be read before or after it."""
        call = self.pick(f"poke({self.record()}, 1)", "fill(p, u)", f"fill({self.record()}.c, v)")
        operand = self.pick(call, f"{call} + {self.leaf()}", f"{self.leaf()} - {call}")
        return f"clamp({operand}, {limits})"

    def test(self) -> str:
        a, b = self.number(1), self.leaf()
        plain = f"{a} {self.pick('<', '<=', '>', '>=', '==', '!=')} {b}"
        other = f"{self.record()}.b < 4"
        shapes = plain, other, f"not {plain}", f"({plain}) and {other}", f"{other} or {plain}"
        return self.pick(*shapes, f"poke({self.record()}, {self.leaf()}) > 1")

    # statements

    def statement(self, depth: int) -> None:
        kinds = ["declared", "stored", "stored", "augmented", "assigned", "called"]
        kinds += ["stepped", "gathered", "unsigned"]
        kinds += ["branch", "loop", "guarded", "relay", "ended"] if depth > 0 else []
        getattr(self, f"_{self.pick(*kinds)}")(depth)

    def _declared(self, depth: int) -> None:
        kind = self.pick("i32", "i64", "u32", "u8")
        number = self.number(2)
        value = {
            "i32": self.pick(self.limited(-(1 << 31), (1 << 31) - 1), self.limited(0, 3)),
            "i64": number,
            "u32": f"to_u32(sat32({number})){self.pick('', ' & 255')}",
            "u8": f"byte({number})",
        }[kind]
        name = self.fresh("x")
        self.put(f"{name}: {kind} = {value}")
        self.names.append((name, kind))

    def _stored(self, depth: int) -> None:
        place, (low, high) = self.place(1)
        if "[" in place and self.draw(st.sampled_from((False, False, True))):
            place = f"{place[: place.index('[')]}[poke({self.record()}, 1)]"
        self.put(f"{place} = {self.limited(low, high)}")

    def _augmented(self, depth: int) -> None:
        local = [name for name, kind in self.names if kind != "u8" and name not in ("u", "v")]
        place = self.pick(self.place(1)[0], *local)
        step = self.pick("1", self.leaf(), f"poke({self.record()}, 1)")
        sign = self.pick("+", "-", "&", "|", "^", ">>")
        self.put(f"{place} {sign}= {self.pick('1', '8') if sign == '>>' else step}")

    def _assigned(self, depth: int) -> None:
        given = [(name, kind) for name, kind in self.names if kind in ("i32", "i64")]
        name, kind = self.draw(st.sampled_from(given))
        others = [other for other, same in given if same == kind]
        value = self.number(1) if kind == "i64" else self.limited(-1000, 1000)
        self.put(f"{name} = {self.pick(value, *others)}")

    def _called(self, depth: int) -> None:
        self.put(self.pick(f"poke({self.record()}, {self.leaf()})", "fill(one.c, u)", "fill(p, v)"))

    def _branch(self, depth: int) -> None:
        self.put(f"if {self.test()}:")
        self.block(depth - 1)
        if self.draw(st.booleans()):
            self.put("else:")
            self.block(depth - 1)

    def _guarded(self, depth: int) -> None:
        """An index that a condition keeps in bounds, of this record or the other."""
        self.put(f"if {self.record()}.b < 4:")
        self.indent += 1
        self.put(f"{self.record()}.a[{self.record()}.b] = {self.limited(-1000, 1000)}")
        self.indent -= 1

    def _first(self) -> str:
        """The start of a loop: known, or a local of a short range."""
        known = self.pick("0", "1", "-1", "4", "")
        if known:
            return known
        name = self.fresh("first")
        self.put(f"{name}: i32 = clamp({self.leaf()}, 0, {self.pick('1', '2')})")
        return name

    def _loop(self, depth: int) -> None:
        first, name = self._first(), self.fresh("k")
        step = self.pick("1", "1", "2", "3", "-1", "-2")
        down = step.startswith("-")
        last = self.pick("-1", "0") if down else self.pick("2", "3", "4", "5", "70", first)
        self.put(f"for {name} in range({first}, {last}, {step}):")
        self.counters.append(name)
        self.block(depth - 1)
        self.counters.pop()

    def _stepped(self, depth: int) -> None:
        """A counter that is an index, in steps from a start of a short range."""
        name = self.fresh("first")
        self.put(f"{name}: i32 = clamp({self.leaf()}, 0, {self.pick('1', '2')})")
        last, step = self.pick("3", "4", "5", "5"), self.pick("2", "3")
        self.put(f"for k{name} in range({name}, {last}, {step}):")
        self.put(f"    {self.pick(*ELEMENTS)}[k{name}] = {self.pick('0', '9')}")

    def _gathered(self, depth: int) -> None:
        """Bits of what a call returns, of a place that it may write."""
        shapes = "p[0] &= fill(p, u)", "one.a[1] &= poke(one, u)", "two.a[1] &= poke(one, v)"
        self.put(self.pick(*shapes))

    def _unsigned(self, depth: int) -> None:
        """The negative of an unsigned number, compared and shifted."""
        name = self.fresh("x")
        self.put(f"{name}: u32 = to_u32({self.pick('u', 'v')}) & 255")
        self.put(f"if -{name} < {self.pick('5', 'v')}:")
        self.put(f"    one.n = clamp(-{name} >> {self.pick('1', '7')}, -100, 100)")

    def _relay(self, depth: int) -> None:
        """Locals that hand a number on, one further each round."""
        names = [self.fresh("r") for _ in range(self.draw(st.integers(2, 9)))]
        for name in names:
            self.put(f"{name}: i32 = 0")
        first = self._first()
        self.put(f"for {self.fresh('k')} in range({first}, {self.pick('6', '80')}):")
        for name, other in zip(names, [*names[1:], self.pick("3", "4", "u & 3")], strict=True):
            self.put(f"    {name} = {other}")
        self.put(f"{self.pick('one.a', 'p')}[{names[0]}] = 1")

    def _ended(self, depth: int) -> None:
        self.put(f"if {self.test()}:")
        self.put(f"    return {self.limited(-1000, 1000)}")


@st.composite
def programs(draw: Callable[..., Any]) -> str:
    """The text of a program with an entry point ``tick``."""
    writer = Writer(draw)
    for _ in range(draw(st.integers(1, 6))):
        writer.statement(2)
    writer.put(f"return sat32({writer.number(2)})")
    return HEAD + "\n".join([*writer.lines, ""])
