"""The proof for the integers against that of the code: what values may be stored."""

from canroll.extensions.certify import checker
from canroll.firmware.state import Ecu
from canroll.firmware.subset import fields

STORED = (
    *("rate_good", "acceleration_good", "x", "ahead", "compensator_x", "ring", "outputs"),
    *("moment", "sent"),
)
"""Fields of the ECU in which the modelled stages store the values that claims bound."""


def within_ranges() -> tuple[str, ...]:
    """Return the fields whose declared ranges hold every value that a claim allows to be stored.

    From these ranges the proof of the code starts (:mod:`canroll.codegen.proof.prove`).

    Raises:
        ValueError: a field's range does not hold them.
    """
    least, most = 1 - checker.LIMIT, checker.LIMIT - 1
    declared = {field.name: field.f for field in fields(Ecu)}
    for name in STORED:
        if not declared[name].lo <= least <= most <= declared[name].hi:
            raise ValueError(f"values from {least} to {most} leave the range of {name}")
    return STORED
