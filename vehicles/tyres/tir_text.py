"""The text of a tyre property file with other numbers: what the file has besides stays."""

import re
from collections.abc import Iterator, Mapping

from canroll.vehicles.tyres.magic_formula import COEFFICIENTS, SCALES
from canroll.vehicles.tyres.tir import SIDES

EMPTY = """\
[MDI_HEADER]
FILE_TYPE                = 'tir'
FILE_VERSION             = 3.0
FILE_FORMAT              = 'ASCII'
[UNITS]
LENGTH                   = 'meter'
FORCE                    = 'newton'
ANGLE                    = 'radians'
MASS                     = 'kg'
TIME                     = 'second'
PRESSURE                 = 'pascal'
"""
"""A file without a tyre."""
SECTIONS = {
    "MODEL": ("FITTYP", "TYRESIDE"),
    "DIMENSION": ("UNLOADED_RADIUS",),
    "OPERATING_CONDITIONS": ("INFLPRES", "NOMPRES"),
    "VERTICAL": ("FNOMIN", "VERTICAL_STIFFNESS", "VERTICAL_DAMPING"),
    "STRUCTURAL": ("LATERAL_STIFFNESS", "PCFY1", "PCFY2", "PCFY3"),
    "INFLATION_PRESSURE_RANGE": ("PRESMIN", "PRESMAX"),
    "VERTICAL_FORCE_RANGE": ("FZMIN", "FZMAX"),
    "LONG_SLIP_RANGE": ("KPUMIN", "KPUMAX"),
    "SLIP_ANGLE_RANGE": ("ALPMIN", "ALPMAX"),
    "INCLINATION_ANGLE_RANGE": ("CAMMIN", "CAMMAX"),
    "SCALING_COEFFICIENTS": SCALES,
    "LONGITUDINAL_COEFFICIENTS": tuple(
        key for key in COEFFICIENTS if re.match(r"P[CDEKHVP]X|R.X", key)
    ),
    "LATERAL_COEFFICIENTS": tuple(
        key for key in COEFFICIENTS if re.match(r"P[CDEKHVPT]Y|R.Y", key)
    ),
    "ALIGNING_COEFFICIENTS": tuple(key for key in COEFFICIENTS if re.match(r"Q|S|PPZ", key)),
}
"""Keys of each section."""
_ENTRY = re.compile(r"\s*([A-Za-z]\w*)\s*=")


def with_numbers(
    text: str, values: Mapping[str, float], notes: Mapping[str, str], title: str
) -> str:
    """Return the text of a file with other numbers.

    Args:
        text: of a file, such as :data:`EMPTY`.
        values: numbers by key; one that the file lacks stands at the end of its section.
        notes: comments behind keys of ``values``.
        title: comment in the first line.
    """
    left = dict(values)
    sections: list[tuple[str, list[str]]] = [("", [f"$ {title}"])]
    for line in text.splitlines():
        if line.lstrip().startswith("["):
            sections.append((line.strip().strip("[]").upper(), [line]))
            continue
        entry = _ENTRY.match(line)
        key = entry.group(1).upper() if entry else ""
        if key in left:
            sections[-1][1].append(_line(key, left.pop(key), notes))
        else:
            sections[-1][1].append(line)
    known = {name: lines for name, lines in sections}
    for name, keys in SECTIONS.items():
        added = [_line(key, left[key], notes) for key in keys if key in left]
        if added and name not in known:
            sections.append((name, [f"[{name}]"]))
            known[name] = sections[-1][1]
        known.get(name, []).extend(added)
    return "\n".join(_lines(sections)) + "\n"


def _lines(sections: list[tuple[str, list[str]]]) -> Iterator[str]:
    for _, lines in sections:
        yield from lines


def _line(key: str, value: float, notes: Mapping[str, str]) -> str:
    side = {number: name for name, number in SIDES.items()}
    text = f"'{side[value]}'" if key == "TYRESIDE" else f"{value:.9g}"
    note = f" $ {notes[key]}" if key in notes else ""
    return f"{key:<24} = {text:<16}{note}".rstrip()
