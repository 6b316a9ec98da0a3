"""Units of signals: what a database calls them, their quantities and their factors.

A field's unit is one of :data:`UNITS`. Databases spell units in many ways, without regard to case:
:func:`normal` makes them one of these.
"""

import math
import re
from dataclasses import dataclass
from fractions import Fraction

from canroll.errors import CanrollError, UnknownNameError

_DEGREE = Fraction(math.pi) / 180
_G = Fraction(980665, 100000)


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its quantity, and how many of the quantity's base unit it is."""

    quantity: str
    factor: Fraction


UNITS: dict[str, Unit] = {
    "": Unit("", Fraction(1)),
    "rad": Unit("angle", Fraction(1)),
    "deg": Unit("angle", _DEGREE),
    "rad/s": Unit("rate", Fraction(1)),
    "deg/s": Unit("rate", _DEGREE),
    "rpm": Unit("rate", Fraction(math.pi) / 30),
    "m": Unit("length", Fraction(1)),
    "cm": Unit("length", Fraction(1, 100)),
    "mm": Unit("length", Fraction(1, 1000)),
    "m/s": Unit("speed", Fraction(1)),
    "mm/s": Unit("speed", Fraction(1, 1000)),
    "km/h": Unit("speed", Fraction(10, 36)),
    "mph": Unit("speed", Fraction(44704, 100000)),
    "m/s2": Unit("acceleration", Fraction(1)),
    "g": Unit("acceleration", _G),
    "N": Unit("force", Fraction(1)),
    "kN": Unit("force", Fraction(1000)),
    "Nm": Unit("moment", Fraction(1)),
    "kNm": Unit("moment", Fraction(1000)),
    "mA": Unit("current", Fraction(1)),
    "A": Unit("current", Fraction(1000)),
}
_BY_CASE = {name.casefold(): name for name in UNITS}
# In this order; what stands before is in lower case and without spaces.
_SPELLINGS = tuple(
    (re.compile(pattern), text)
    for pattern, text in (
        (r"â(?=[°²·])|^unit_", ""),  # UTF-8 that was taken for Latin-1; CANdb's names
        (r"^(?:-|1|none|unitless|n/?a)$", ""),
        (r"²|\^2|\*\*2", "2"),
        (r"[·⋅*]", ""),
        (r"°?(?:grad|degre+s?|degs?)(?:ofarc)?|°", "deg"),
        (r"radians?", "rad"),
        (r"kilo(?=m|n)", "k"),
        (r"milli(?=m|a)", "m"),
        (r"centi(?=m)", "c"),
        (r"met(?:er|re)s?", "m"),
        (r"newtons?|newto", "n"),
        (r"(?<=n)[.-](?=m)", ""),
        (r"amp(?:[eè]re?s?|s)?", "a"),
        (r"per", "/"),
        (r"(?<=/)se[ck][a-z]*?(?=\W|\d|squar|$)", "s"),
        (r"(?<=/)square?s[a-z]*$", "s2"),
        (r"(?<=/)(?:hours?|hr?|std)(?=\W|$)", "h"),
        (r"(?<=/s)(?:squared?|squar|/s)", "2"),
        (r"^(?:kph|kmh|kmph)$", "km/h"),
        (r"^(?:miles?/h|mi/h)$", "mph"),
        (r"^(?:1/min|u/min|r/min|rev/min|min-1|umdr/min)$", "rpm"),
        (r"^(?:forceofgravity|forceofgravi|g-force)$", "g"),
    )
)


def normal(unit: str) -> str | None:
    """Return a database's unit as one of :data:`UNITS`, None where it is none of them."""
    text = "".join(unit.casefold().split())
    for pattern, replacement in _SPELLINGS:
        text = pattern.sub(replacement, text)
    return _BY_CASE.get(text)


def conversion(unit: str, field_unit: str, field: str, where: str) -> Fraction:
    """Return the factor from a signal's unit to that of its field.

    Args:
        unit: the signal's, as the database or the map has it.
        field_unit: the field's.
        field: its name, for errors.
        where: place in the map, for errors.

    Raises:
        CanrollError: a unit is unknown, or one of another quantity.
    """
    theirs, ours = normal(unit), normal(field_unit)
    if ours is None:
        raise UnknownNameError(f"unit in {where}", field_unit, UNITS)
    quantity = UNITS[ours].quantity
    alike = [name for name, each in UNITS.items() if each.quantity == quantity and name]
    if theirs is None and alike:
        raise UnknownNameError(f"unit in {where}", unit, alike)
    if theirs is None or UNITS[theirs].quantity != quantity:
        remedy = f"give the signal's unit in the map: {', '.join(alike)}"
        if not alike:
            remedy = 'give unit = "" in the map if the signal is a plain number'
        raise CanrollError(
            f"{where}: unit '{unit}' does not match {field} ('{field_unit}'): {remedy}"
        )
    return UNITS[theirs].factor / UNITS[ours].factor
