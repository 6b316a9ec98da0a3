"""A certificate held against the vehicle, bus and calibration that it is to be of.

The checker takes car, delays, resolutions and bounds of steering as the file has them; here they
are computed anew. Numbers of the car agree to nine digits: another computer rounds otherwise.
"""

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from canroll.extensions.certify.certificate import EVERY_TICK, TRIGGER
from canroll.extensions.certify.disturbed import LATERAL, disturbances
from canroll.extensions.certify.subject import subject
from canroll.gain_gen.analysis.family import Family
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.task import Task

RELATIVE = 1e-9
"""Difference of numbers that count as the same."""
ROUNDED = 1e-13
"""The same relative to the largest of their column, for what is zero but for rounding."""
OF_A_CONDITION = ("speed", "flow", "readings", "roll")
OF_A_MODEL = ("flow", "performance")


def differences(
    content: Mapping[str, Any], task: Task, calibration: LoadedCalibration
) -> Iterator[str]:
    """Yield in words where a certificate is not that of a task's vehicle, bus and calibration.

    Args:
        content: that the checker has accepted.
        task: with the vehicle and the bus.
        calibration: the file that it was checked with.

    Raises:
        CanrollError: the loop of this calibration is none that can be certified.
    """
    family, expected = subject(task, calibration)
    for key, value in expected["source"].items():
        if content["source"][key] != value:
            yield f"{key} is {content['source'][key]}, not {value}"
    for key in ("delay", "resolution"):
        if not _same(content[key], expected[key]):
            stated, anew = (_numbers(of[key]).tolist() for of in (content, expected))
            yield f"{key} is {stated}, not {anew}"
    yield from _others(content["conditions"], expected["conditions"], OF_A_CONDITION)
    yield from _others(content["models"], expected["models"], OF_A_MODEL)
    given = {of["name"]: of for of in content["conditions"]}
    for member, condition in zip(family.members, expected["conditions"], strict=True):
        triggered = calibration.record.event_trigger and not member.condition.draw
        wanted = TRIGGER if triggered else EVERY_TICK
        of = given.get(condition["name"], {"claims": []})
        if wanted not in {claim["name"] for claim in of["claims"]}:
            yield f"{condition['name']}: there is no claim '{wanted}'"
    if any("driven" in of for of in content["conditions"]) and not _is_of_a_level(
        given, expected["conditions"], family, task, calibration
    ):
        tried = ", ".join(f"{lateral:g}" for lateral in LATERAL)
        yield f"driven is not that of a steady lateral acceleration of {tried} m/s²"


def _others(
    given: list[dict[str, Any]], expected: list[dict[str, Any]], keys: tuple[str, ...]
) -> Iterator[str]:
    """Yield what differs of conditions or models."""
    known = {of["name"]: of for of in given}
    for of in expected:
        other = known.pop(of["name"], None)
        if other is None:
            yield f"{of['name']}: is missing"
            continue
        for key in keys:
            if not _same(other[key], of[key]):
                yield f"{of['name']}: {key} is another"
    yield from (f"{name}: is no condition of this vehicle" for name in known)


def _is_of_a_level(
    given: Mapping[str, Any],
    conditions: list[dict[str, Any]],
    family: Family,
    task: Task,
    calibration: LoadedCalibration,
) -> bool:
    """Whether the bounds of steering are of one of the lateral accelerations that are tried."""
    members = [
        (given.get(condition["name"], {}).get("driven", []), member)
        for member, condition in zip(family.members, conditions, strict=True)
        if not member.condition.draw
    ]

    def fits(lateral: float) -> bool:
        for driven, member in members:
            wanted = disturbances(member, task, calibration.record, lateral)
            if [each["input"] for each in driven] != list(wanted):
                return False
            if not _same([[each["most"] for each in driven]], [list(wanted.values())]):
                return False
        return True

    return any(map(fits, LATERAL))


def _same(given: Any, expected: Any) -> bool:  # noqa: ANN401 - a number, a vector or a matrix
    """Whether numbers of a file, as texts or integers, are those expected."""
    a, b = _numbers(given), _numbers(expected)
    if a.shape != b.shape:
        return False
    allowed = RELATIVE * np.abs(b) + ROUNDED * np.abs(b).max(axis=0)
    return bool(np.all(np.abs(a - b) <= allowed))


def _numbers(rows: Any) -> Matrix:  # noqa: ANN401
    of = np.vectorize(lambda number: float(Fraction(number)), otypes=[float])
    return np.atleast_1d(of(np.array(rows, dtype=object)))
