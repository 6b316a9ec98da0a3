"""The subset's statements of one checksum: its fold over the bytes of a frame, without a loop.

In frames of more than eight bytes those that follow each other are taken in loops. A CRC takes a
byte by a table of 256 entries, one of more than eight bits in a short frame by two of 16.
"""

from collections.abc import Callable, Iterator, Sequence

from canroll.codegen.frame.checksum import Bits, Checksum, Unit

WRITTEN_OUT = 8
"""Bytes of a frame up to which a loop would cost more than its body."""
LOOPED = 4
"""Bytes in a row from which a loop of a longer frame takes them."""
KINDS = {8: "i32", 16: "u32", 32: "u32"}


def result_kind(checksum: Checksum) -> str:
    """The type that its function returns."""
    if checksum.function is not None:
        return checksum.function.result
    return "i32" if checksum.width < 32 else "u32" if checksum.width == 32 else "i64"


def number_text(parts: Sequence[Bits], payload: str) -> str:
    """The expression of a number that a frame has, in brackets where an operator needs them."""
    return _joined([_bits(part, payload) for part in parts])


def _joined(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"({' | '.join(parts)})"


def _bits(bits: Bits, payload: str, listed: str = "") -> str:
    """The expression of some bits of a unit, ready to be an operand."""
    if bits.source == "constant":
        assert isinstance(bits.at, int)
        return str((bits.at >> bits.shift & bits.mask) << bits.left)
    source = {"identity": "identity", "listed": listed}.get(bits.source, f"{payload}[{bits.at}]")
    text = f"{source} >> {bits.shift}" if bits.shift else source
    if bits.source == "identity" and bits.mask == 255:
        text = f"byte({text})"
    elif bits.source == "identity" or (bits.source == "byte" and bits.mask != 255 >> bits.shift):
        text = f"(({text}) & {bits.mask})" if bits.shift else f"({text} & {bits.mask})"
    elif bits.shift:
        text = f"({text})"
    return f"({text} << {bits.left})" if bits.left else text


class Writer:
    """Statements of one checksum's function."""

    def __init__(self, checksum: Checksum, length: int, counter: str, number: int) -> None:
        """Prepare them for frames of ``length`` bytes, whose ``counter`` is that expression."""
        self.checksum = checksum
        self.long = length > WRITTEN_OUT
        self.counter = counter
        self.number = number

    def lines(self) -> Iterator[str]:
        """All statements, each indented."""
        fold = {"crc": self._crc, "sum": self._sum, "xor": self._xor}[self.checksum.fold]
        yield from (f"    {line}" for line in fold())

    # units

    def text(self, unit: Unit) -> str:
        """The expression of a unit, in brackets where an operator needs them."""
        parts = []
        for bits in unit:
            listed = ""
            if isinstance(bits.at, tuple):
                which = self.checksum.lists.index(bits.at)
                listed = f"{list_name(self.number, which)}[{self.counter}]"
            parts.append(_bits(bits, "payload", listed))
        return _joined(parts)

    def _steps(self, step: Callable[[str], Sequence[str]]) -> Iterator[str]:
        """The statements that take in all units, with loops over bytes in a row."""
        units = list(self.checksum.units)
        while units:
            count = _in_a_row(units) if self.long else 1
            if count < LOOPED:
                yield from step(self.text(units.pop(0)))
                continue
            first, last = (int(units[k][0].at) for k in (0, count - 1))  # type: ignore[arg-type]
            down = last < first
            bounds = f"{first}, {last - 1}, -1" if down else f"{first}, {last + 1}"
            yield f"for k in range({bounds}):"
            yield from (f"    {line}" for line in step("payload[k]"))
            del units[:count]

    # folds

    def _crc(self) -> Iterator[str]:
        its = self.checksum
        if its.register == 8 and not self.long:
            yield from self._crc_of_a_byte()
            return
        names = table_names(its, self.long)
        if its.register == 64:
            first = its.first_register
            yield f"high: u32 = {first >> 32}"
            yield f"low: u32 = {first & 0xFFFFFFFF}"
            yield "entry: u32 = 0"
            yield from self._steps(lambda unit: _step_64(unit, names, reflected=its.reflect_in))
            yield from self._end_64()
            return
        yield f"crc: {KINDS[its.register]} = {its.first_register}"
        yield from self._steps(
            lambda unit: _step(unit, names[0], its, bits=4 if by_nibbles(its, self.long) else 8)
        )
        yield from self._end("crc", KINDS[its.register])

    def _crc_of_a_byte(self) -> Iterator[str]:
        """A CRC of up to eight bits, whose register is the index of the next entry."""
        its, (name,) = self.checksum, table_names(self.checksum, self.long)
        steps = [self.text(unit) for unit in its.units]
        start = f"{its.first_register} ^ " if its.first_register else ""
        yield f"crc: i32 = {name}[{start}{steps[0]}]"
        if len(steps) > 2:
            yield "# written out: a loop would cost more than its body"
        plain = its.width == 8 and its.reflect_in == its.reflect_out
        last = len(steps) - 1 if plain and len(steps) > 1 else len(steps)
        yield from (f"crc = {name}[crc ^ {step}]" for step in steps[1:last])
        if last < len(steps):
            end = f" ^ {its.end}" if its.end else ""
            yield f"return {name}[crc ^ {steps[-1]}]{end}"
        else:
            yield from self._end("crc", "i32")

    def _end(self, name: str, kind: str) -> Iterator[str]:
        """From a register of up to 32 bits to the result."""
        its = self.checksum
        text = name
        if not its.reflect_in and its.width < its.register:
            text = f"({name} >> {its.register - its.width})"
        if its.reflect_in != its.reflect_out:
            yield f"rest: {kind} = {text.removeprefix('(').removesuffix(')')}"
            yield f"turned: {kind} = 0"
            yield f"for _ in range({its.width}):"
            yield f"    turned = ((turned & {(1 << its.width - 1) - 1}) << 1) | (rest & 1)"
            yield "    rest = rest >> 1"
            text = "turned"
        if its.end:
            yield f"return {text} ^ {its.end}"
        else:
            yield f"return {text.removeprefix('(').removesuffix(')')}"

    def _end_64(self) -> Iterator[str]:
        its = self.checksum
        shift = 0 if its.reflect_in else its.register - its.width
        if its.reflect_in != its.reflect_out:
            yield "upper: u32 = 0"
            yield "lower: u32 = 0"
            yield "for _ in range(64):"
            yield f"    upper = ((upper & {0x7FFFFFFF}) << 1) | (lower >> 31)"
            yield f"    lower = ((lower & {0x7FFFFFFF}) << 1) | (low & 1)"
            yield "    low = (low >> 1) | ((high & 1) << 31)"
            yield "    high = high >> 1"
            yield "high = upper"
            yield "low = lower"
            # the register is reversed whole: a shorter CRC stands at its other end
            shift = 64 - its.width if its.reflect_in else 0
        end = its.end << shift
        if end:
            yield f"high = high ^ {end >> 32}"
            yield f"low = low ^ {end & 0xFFFFFFFF}"
        yield "whole: i64 = to_i32(high)"
        yield "whole = (whole << 32) | low"
        bits = (1 << its.width) - 1
        if its.width == 64:
            yield "return whole"
        else:
            yield f"return (whole >> {shift}) & {bits}" if shift else f"return whole & {bits}"

    def _sum(self) -> Iterator[str]:
        its = self.checksum
        most = its.most + (0 if its.negate else its.start)
        room = (1 << most.bit_length()) - 1
        kind = "i32" if room < 1 << 31 else "i64"
        first = 0 if its.negate else its.start
        yield f"total: {kind} = {first}"
        yield from self._steps(lambda unit: [f"total += {_parts(unit, its.unit)}"])
        low = (1 << its.width) - 1
        while its.carry and most > low:
            yield f"total = (total & {low}) + (total >> {its.width})"
            carried, rest = most >> its.width, most & low
            most = max(low + carried - 1, rest + carried)
        text = f"({its.start} - total)" if its.negate else "total"
        end = f" ^ {its.end}" if its.end else ""
        yield f"return ({text} & {low}){end}" if end else f"return {text} & {low}"

    def _xor(self) -> Iterator[str]:
        its = self.checksum
        kind = "i32" if its.unit <= 16 else "i64"
        yield f"value: {kind} = 0"
        yield from self._steps(lambda unit: [f"value = value ^ {unit}"])
        for shift in (4, 2, 1):
            if shift >= its.unit:
                yield f"value = value ^ (value >> {shift})"
        low = (1 << min(its.unit, its.width)) - 1
        text = f"value & {low}" if its.unit < 8 or its.width < its.unit else "value"
        last = its.start ^ its.end
        yield f"return ({text}) ^ {last}" if last else f"return {text}"


def by_nibbles(checksum: Checksum, long: bool) -> bool:
    """Whether a CRC takes four bits at a time, by a table of 16 entries."""
    return checksum.register == 64 or (checksum.register > 8 and not long)


def list_name(number: int, which: int) -> str:
    """Name of the table of a list of constants, of which a checksum may have several."""
    return f"LISTED_{number}_{which}"


def table_names(checksum: Checksum, long: bool) -> tuple[str, ...]:
    """Names of the tables of a CRC."""
    digits = (checksum.width + 3) // 4
    turned = "R" if checksum.reflect_in else ""
    entries = "_OF_4" if by_nibbles(checksum, long) else ""
    name = f"CRC{checksum.width}_{checksum.polynomial:0{digits}X}{turned}{entries}"
    return (f"{name}_HIGH", f"{name}_LOW") if checksum.register == 64 else (name,)


def crc_tables(checksum: Checksum, length: int) -> Iterator[tuple[str, str, tuple[int, ...]]]:
    """Name, kind and entries of each table of a CRC over a frame of ``length`` bytes."""
    long = length > WRITTEN_OUT
    entries = checksum.table
    if by_nibbles(checksum, long):
        entries = entries[::16] if checksum.reflect_in else entries[:16]
    names = table_names(checksum, long)
    if checksum.register == 64:
        yield names[0], "u32", tuple(entry >> 32 for entry in entries)
        yield names[1], "u32", tuple(entry & 0xFFFFFFFF for entry in entries)
    else:
        yield names[0], f"u{checksum.register}", entries


def _in_a_row(units: Sequence[Unit]) -> int:
    """Number of whole bytes of the frame from the first on that follow each other."""
    numbers: list[int] = []
    for unit in units:
        bits = unit[0]
        whole = len(unit) == 1 and bits == Bits("byte", bits.at)
        if not whole or not isinstance(bits.at, int):
            break
        way = numbers[1] - numbers[0] if len(numbers) > 1 else None
        if numbers and bits.at - numbers[-1] not in ((way,) if way else (1, -1)):
            break
        numbers.append(bits.at)
    return len(numbers)


def _parts(unit: str, width: int) -> str:
    """A unit of eight bits as its parts of ``width`` bits, added."""
    if width >= 8:
        return unit
    if unit.isdigit():
        return str(sum(int(unit) >> k & (1 << width) - 1 for k in range(0, 8, width)))
    most = (1 << width) - 1
    parts = [f"({unit} >> {k})" if k else unit for k in range(0, 8, width)]
    masked = [part if k == len(parts) - 1 else f"({part} & {most})" for k, part in enumerate(parts)]
    return " + ".join(masked)


def _step(unit: str, name: str, its: Checksum, bits: int) -> list[str]:
    """Take a unit into a CRC's register of 8, 16 or 32 bits, ``bits`` at a time."""
    register = its.register
    low = (1 << bits) - 1
    lines = []
    halves = [unit] if bits == 8 else [f"({unit} & 15)", f"({unit} >> 4)"]
    for part in halves if its.reflect_in else reversed(halves):
        if register == bits:
            lines.append(f"crc = {name}[crc ^ {part}]")
        elif its.reflect_in:
            lines.append(f"crc = {name}[(crc & {low}) ^ {part}] ^ (crc >> {bits})")
        else:
            kept = (1 << register - bits) - 1
            index = f"(crc >> {register - bits}) ^ {part}"
            lines.append(f"crc = {name}[{index}] ^ ((crc & {kept}) << {bits})")
    return lines


def _step_64(unit: str, names: Sequence[str], *, reflected: bool) -> list[str]:
    """Take a unit into the two halves of a CRC's register, four bits at a time."""
    lines = []
    halves = [f"({unit} & 15)", f"({unit} >> 4)"]
    for part in halves if reflected else reversed(halves):
        if reflected:
            lines += [
                f"entry = (low & 15) ^ {part}",
                f"low = ((low >> 4) | ((high & 15) << 28)) ^ {names[1]}[entry]",
                f"high = (high >> 4) ^ {names[0]}[entry]",
            ]
        else:
            lines += [
                f"entry = (high >> 28) ^ {part}",
                f"high = (((high & 268435455) << 4) | (low >> 28)) ^ {names[0]}[entry]",
                f"low = ((low & 268435455) << 4) ^ {names[1]}[entry]",
            ]
    return lines
