from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canroll.arguments import checked
from canroll.errors import CanrollError


class Car:
    pass


@checked
def drive(
    speeds: Sequence[float] = (),
    *,
    runs: int | None = None,
    share: Mapping[str, float | str] | None = None,
    file: str | Path = "",
    car: Car | None = None,
    watch: Callable[[str], None] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Drive a car."""
    values = {"speeds": speeds, "runs": runs, "share": share, "file": file, "car": car}
    return {**values, "watch": watch, **more}


@pytest.mark.parametrize(
    "given",
    [
        {"speeds": [60, 80.5]},
        {"speeds": np.arange(60.0, 100.0, 20.0)},
        {"runs": np.int64(3)},
        {"share": {"mass": 0.1, "speed": "0.2"}},
        {"file": Path("a")},
        {"car": Car()},
        {"watch": print},
        {"unknown": object()},
    ],
)
def test_what_fits_its_annotation_is_passed_on(given):
    ((name, value),) = given.items()
    assert drive(**given)[name] is value


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"speeds": "80"}, "speeds='80': must be a list of numbers"),
        ({"speeds": {80: 1}}, "speeds={80: 1}: must be a list of numbers"),
        ({"speeds": [True]}, "speeds=[True]: must be a list of numbers"),
        ({"speeds": 3.0}, "speeds=3.0: must be a list of numbers"),
        ({"runs": 2.5}, "runs=2.5: must be a whole number"),
        ({"share": {"mass": None}}, "must be a dictionary of numbers or texts by name"),
        ({"share": {3: 0.1}}, "must be a dictionary of numbers or texts by name"),
        ({"file": 3}, "file=3: must be a text, or a path"),
        ({"car": "van"}, "car='van': must be a Car"),
        ({"watch": 3}, "watch=3: must be a function"),
        ({"speeds": ["x" * 100]}, "...: must be a list of numbers"),
    ],
)
def test_what_does_not_is_refused_by_name(given, message):
    with pytest.raises(CanrollError) as refused:
        drive(**given)
    assert message in str(refused.value)


def test_a_checked_function_keeps_name_and_text():
    assert (drive.__name__, drive.__doc__) == ("drive", "Drive a car.")
