"""canroll_gains.h: one calibration as a C99 initialiser, with its type, formats and meanings."""

from collections.abc import Iterable, Mapping

from canroll.codegen.c99.text import declaration, filled, plain
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import Field, fields

WIDTH = 96
TYPE_GUARD = "CANROLL_CALIBRATION_TYPE"
TYPE_NAME = "canroll_calibration"
CRC_NAME = "CANROLL_CALIBRATION_CRC"


def gains_header(
    record: Calibration,
    *,
    title: Iterable[str],
    physical: Mapping[str, str] | None = None,
) -> str:
    """Return the header's text.

    Args:
        record: the calibration.
        title: lines for the comment at the top: law, vehicle, verdict.
        physical: values in SI units by field name, for fields whose Q format alone does not
            give them.

    Returns:
        C99 that compiles alone: the type of the record (behind a guard, so that it can stand
        beside the firmware's own headers), ``CANROLL_CALIBRATION_INITIALISER`` and the CRC.
    """
    table = fields(Calibration)
    physical = physical or {}
    lines = ["/*"]
    lines += [f" * {plain(' '.join(line.splitlines()))}".rstrip() for line in title]
    lines += [
        " *",
        " * Written by 'canroll design'. A value n of format Qq stands for n / 2^q of its unit.",
        " * Use: static const canroll_calibration gains = CANROLL_CALIBRATION_INITIALISER;",
        " */",
        "#ifndef CANROLL_GAINS_H",
        "#define CANROLL_GAINS_H",
        "",
        "#include <stdint.h>",
        "",
        f"#ifndef {TYPE_GUARD}",
        f"#define {TYPE_GUARD}",
        "typedef struct {",
    ]
    for field in table:
        lines.append(
            f"    {declaration(field.kind, field.name, field.shape)}; /* {_meaning(field)} */"
        )
    lines += [f"}} {TYPE_NAME};", "#endif", "", "#define CANROLL_CALIBRATION_INITIALISER { \\"]
    for field in table:
        lines += _initialiser(field, getattr(record, field.name), physical.get(field.name, ""))
    lines += ["}", "", f"#define {CRC_NAME} 0x{record.crc & 0xFFFFFFFF:08X}u", ""]
    lines += ["#endif /* CANROLL_GAINS_H */", ""]
    return "\n".join(lines)


def _meaning(field: Field) -> str:
    """Return unit, format and meaning of a field from the field table."""
    unit = f"{field.f.unit}, " if field.f.unit else ""
    q = f"Q{field.f.q}, " if field.f.q else ""
    return plain(f"{unit}{q}{field.f.meaning}")


def _value_in_units(field: Field, value: object) -> str:
    """Return the physical value of a field whose format is fixed."""
    if not field.f.q:
        return ""
    unit = f" {field.f.unit}" if field.f.unit else ""
    if isinstance(value, int):
        return f"{value / 2**field.f.q:.6g}{unit}"
    if isinstance(value, list) and value and isinstance(value[0], int):
        return ", ".join(f"{item / 2**field.f.q:.6g}" for item in value) + unit
    return ""


def _initialiser(field: Field, value: object, physical: str) -> list[str]:
    """Return the lines of one member: a comment with its physical value, then its integers."""
    said = physical or _value_in_units(field, value)
    note = plain(f"{field.name} = {said}" if said else field.name)
    numbers = filled(f"{_literal(value)},".split(" "), WIDTH)
    return [f"{line} \\" for line in (f"    /* {note} */", *numbers)]


def _literal(value: object) -> str:
    """Return a C literal; INT32_MIN has none of type int32_t and becomes an expression."""
    if isinstance(value, list):
        return "{ " + ", ".join(_literal(item) for item in value) + " }"
    assert isinstance(value, int)
    return "(-2147483647 - 1)" if value == -(2**31) else str(value)
