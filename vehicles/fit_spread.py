"""How sure the fitted numbers of a vehicle are: the section ``fit`` of its file."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from canroll.documents import refuse_unknown
from canroll.errors import CanrollError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SECTION = "fit"
KEYS = ("log", "names", "deviations", "correlation")


@dataclass(frozen=True, slots=True)
class FitSpread:
    """Joint spread of numbers that were fitted together.

    Attributes:
        log: what they were fitted on.
        names: keys of the vehicle file; that of one number of a list ends in its place.
        deviations: standard deviations, in the units of the numbers.
        correlation: lower triangle with the diagonal of ones, a row for each number.
    """

    log: str
    names: tuple[str, ...]
    deviations: tuple[float, ...]
    correlation: tuple[tuple[float, ...], ...]

    @property
    def matrix(self) -> "NDArray[np.float64]":
        """The correlation, (p, p)."""
        import numpy as np  # noqa: PLC0415 - which names of vehicles need not

        lower = np.zeros((len(self.names), len(self.names)))
        for i, row in enumerate(self.correlation):
            lower[i, : i + 1] = row
        return np.asarray(lower + np.tril(lower, -1).T)


def section_of(
    log: str, names: Collection[str], covariance: "NDArray[np.float64]"
) -> dict[str, object]:
    """Return the section for numbers of a covariance (p, p), in products of their units."""
    import numpy as np  # noqa: PLC0415

    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    np.fill_diagonal(correlation, 1.0)
    return {
        "log": log,
        "names": list(names),
        "deviations": deviations.tolist(),
        "correlation": [row[: i + 1].tolist() for i, row in enumerate(correlation)],
    }


def of_section(table: object, where: str) -> FitSpread:
    """Return the spread of a file's section.

    Raises:
        CanrollError: a key is missing, unknown or wrong; the message begins with ``where``.
    """
    import numpy as np  # noqa: PLC0415

    if not isinstance(table, Mapping):
        raise CanrollError(f"{where}: '{SECTION}' must be a table")
    refuse_unknown(table, KEYS, f"key of {where}: [{SECTION}]")
    for key in KEYS:
        if key not in table:
            raise CanrollError(f"{where}: [{SECTION}] missing key '{key}'")
    log, names, deviations, rows = (table[key] for key in KEYS)
    at = f"{where}: {SECTION}"
    if not isinstance(log, str) or not log.strip():
        raise CanrollError(f"{at}.log must be a string")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise CanrollError(f"{at}.names must be a list of keys, as 'plant.roll_stiffness'")
    if len(set(names)) < len(names):
        raise CanrollError(f"{at}.names: each once")
    count = len(names)
    if not _numbers(deviations, count) or min(deviations) <= 0:
        raise CanrollError(f"{at}.deviations must be {count} positive numbers, one for each name")
    if (
        not isinstance(rows, list)
        or len(rows) != count
        or not all(_numbers(row, i) for i, row in enumerate(rows, 1))
    ):
        raise CanrollError(f"{at}.correlation must be {count} rows of 1, 2, … {count} numbers")
    spread = FitSpread(
        log,
        tuple(names),
        tuple(float(number) for number in deviations),
        tuple(tuple(float(number) for number in row) for row in rows),
    )
    if any(row[-1] != 1.0 for row in spread.correlation):
        raise CanrollError(f"{at}.correlation: each row must end in 1, that with itself")
    try:
        np.linalg.cholesky(spread.matrix)
    except np.linalg.LinAlgError as error:
        raise CanrollError(
            f"{at}.correlation is not positive definite: no numbers are correlated like this"
        ) from error
    return spread


def _numbers(values: object, count: int) -> bool:
    return (
        isinstance(values, list)
        and len(values) == count
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        and all(isfinite(v) for v in values)
    )


def value_of(vehicle: object, key: str) -> float:
    """Return the number of a vehicle at a key; the place in a list is the last part of a key.

    Raises:
        AttributeError, IndexError, TypeError, ValueError: it has none there; what follows from its
            numbers, such as a natural frequency, is none.
    """
    part: Any = vehicle
    for name in key.split("."):
        if isinstance(part, tuple):
            if not name.isdecimal():  # as "-1", which is a place of a list in Python alone
                raise ValueError(name)
            part = part[int(name)]
        elif name in part.__dataclass_fields__:
            part = getattr(part, name)
        else:
            raise AttributeError(name)
    return float(part)


def without(table: Mapping[str, Any], given: Collection[str]) -> dict[str, Any] | None:
    """Return a vehicle file's section without numbers that are given now, or None without any.

    Args:
        table: the section.
        given: keys, of numbers, lists or sections.
    """
    import numpy as np  # noqa: PLC0415

    spread = of_section(dict(table), "fit")
    kept = [
        i
        for i, name in enumerate(spread.names)
        if not any(f"{name}.".startswith(f"{key}.") for key in given)
    ]
    if not kept:
        return None
    deviations = np.array(spread.deviations)[kept]
    covariance = spread.matrix[np.ix_(kept, kept)] * np.outer(deviations, deviations)
    return section_of(spread.log, [spread.names[i] for i in kept], covariance)
