"""A measured table of a tyre: slip angle, load, camber and lateral force, in axes of .tir files.

Columns of a CSV are found by name, with the unit as a suffix of the name, else in SI units; lines
that begin with ``#``, ``%``, ``$`` or ``!`` are comments. Axes are those of ISO 8855 (TYDEX W),
SAE J670, or SAE adapted by Pacejka (Tire and Vehicle Dynamics, appendix 1), in which the force
rises with the slip angle.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim.driving.columns import read_table
from canroll.typing import Vector


class Column(NamedTuple):
    """A column of a table: label, names, factors of units to SI, and the most that SI can be."""

    label: str
    names: tuple[str, ...]
    units: dict[str, float]
    most: float


_ANGLE = {"rad": 1.0, "deg": pi / 180.0}
_FORCE = {"n": 1.0, "kn": 1000.0}
COLUMNS = {
    "slip_angle": Column("slip angle", ("slip_angle", "alpha", "sa"), _ANGLE, 1.5),
    "load": Column("load", ("load", "vertical_load", "fz"), _FORCE, 1e6),
    "camber": Column("camber", ("camber", "inclination", "inclination_angle", "ia"), _ANGLE, 1.0),
    "force": Column("lateral force", ("lateral_force", "fy"), _FORCE, 1e6),
}
"""Columns of a table; all but the camber are needed."""
OPTIONAL = "camber"
AXES = {"iso": (1.0, 1.0), "sae": (-1.0, -1.0), "adapted-sae": (1.0, -1.0)}
"""Factors of slip angle and lateral force to those of ISO 8855; the camber is the same in all."""
LEAST_LOAD = 50.0
"""Load (N) below which the largest of a table is taken for one in kN."""
LINEAR = 0.4
"""Share of the largest force over load up to which a tyre is about linear."""
TOLD = 3.0
"""Standard deviations from which the sign of the camber's effect is clear."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTyre:
    """A measured table in axes of ISO 8855: angles (rad), load and lateral force (N), each (n).

    ``remarks`` say what was left out.
    """

    name: str
    slip_angle: Vector
    load: Vector
    camber: Vector
    force: Vector
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.force)

    @property
    def grip(self) -> float:
        """Largest lateral force over load but for one point in twenty."""
        return float(np.quantile(np.abs(self.force) / self.load, 0.95))

    def linear(self) -> tuple[Vector, Vector]:
        """Slopes of force over load, and their standard deviations, where forces are small.

        Over a constant, the slip angle and the camber (1/rad). What the slope over the slip angle
        does over load and over the slip itself is taken out.
        """
        share = self.force / self.load
        slip, load = np.tan(self.slip_angle), self.load / self.load.mean() - 1.0
        columns = (np.ones(len(self)), slip, np.sin(self.camber), slip * load, slip**3)
        enough = np.sort(np.abs(share))[: 3 * len(columns)][-1]
        small = np.abs(share) <= max(LINEAR * self.grip, float(enough))
        over, share = np.column_stack(columns)[small], share[small]
        inverse = np.linalg.pinv(over.T @ over)
        slopes = inverse @ over.T @ share
        spare = max(len(over) - int(np.linalg.matrix_rank(over)), 1)
        noise = float(np.sum((share - over @ slopes) ** 2)) / spare
        return slopes[:3], np.sqrt(noise * np.diag(inverse)[:3])


def read(path: Path, axes: str) -> MeasuredTyre:
    """Return a measured table.

    Args:
        path: of the CSV file.
        axes: a key of :data:`AXES`.

    Raises:
        CanrollError: it cannot be read, lacks a column, has values that cannot be those of its
            unit, or signs that are not those of its axes.
    """
    table = read_table(path)
    if not table.names:
        raise CanrollError(f"{path}: no table: a line with the names of columns, then numbers")
    numbers, names, remarks = {}, {}, []
    for key, column in COLUMNS.items():
        place, factor = _column(path, table.names, column, needed=key != OPTIONAL)
        if place is not None:
            names[key] = table.names[place]
            numbers[key] = factor * table.numbers(place)
    numbers.setdefault(OPTIONAL, np.zeros_like(numbers["force"]))
    whole = np.isfinite(np.column_stack(list(numbers.values()))).all(axis=1)
    if not whole.all():
        remarks.append(f"{path.name}: {np.sum(~whole)} rows without a number: left out")
    values = {key: column[whole] for key, column in numbers.items()}
    if not len(values["force"]):
        raise CanrollError(f"{path}: no row with numbers: is it a table of a tyre?")
    _check_units(path, values, names)
    load = values["load"]
    if (load < 0.0).all():
        if axes != "sae":
            raise CanrollError(f"{path}: loads are negative, as in SAE axes: give --axes sae")
        load = -load
    if not (load > 0.0).all():
        raise CanrollError(
            f"{path}: {names['load']}: {load[int(np.argmin(load > 0.0))]:.4g} N: a load must be "
            "positive"
        )
    raw = MeasuredTyre(path.name, values["slip_angle"], load, values["camber"], values["force"])
    _check_axes(path, raw, axes)
    slip, force = AXES[axes]
    return MeasuredTyre(
        path.name, slip * raw.slip_angle, load, raw.camber, force * raw.force, tuple(remarks)
    )


def _column(
    path: Path, header: Sequence[str], column: Column, *, needed: bool
) -> tuple[int | None, float]:
    """Place and factor to SI of a column; None where the table lacks one that it may lack."""
    known = {
        f"{name}{suffix}": factor
        for name in column.names
        for suffix, factor in [("", 1.0), *((f"_{u}", f) for u, f in column.units.items())]
    }
    places = [place for place, name in enumerate(header) if name.lower() in known]
    if len(places) > 1:
        both = " and ".join(header[place] for place in places[:2])
        raise CanrollError(f"{path}: {both} are both the {column.label}: remove one")
    if not places:
        if not needed:
            return None, 1.0
        units = " or ".join(f"{column.names[0]}_{unit}" for unit in column.units)
        raise CanrollError(f"{path}: no column of the {column.label}: name it {units}")
    return places[0], known[header[places[0]].lower()]


def _check_units(path: Path, values: dict[str, Vector], names: dict[str, str]) -> None:
    for key, name in names.items():
        column, largest = COLUMNS[key], float(np.abs(values[key]).max())
        if largest > column.most:
            unit, *others = column.units
            raise CanrollError(
                f"{path}: {name}: up to {largest:.3g} {unit.upper() if unit == 'n' else unit}: if "
                f"it is in {others[0]}, name the column {column.names[0]}_{others[0]}"
            )
    if (largest := float(np.abs(values["load"]).max())) < LEAST_LOAD:
        raise CanrollError(
            f"{path}: {names['load']}: up to {largest:.3g} N: if it is in kN, name the column "
            "load_kn"
        )
    if not np.abs(values["force"]).max() > 0.0:
        raise CanrollError(f"{path}: {names['force']}: all forces are 0")


def _signs(axes: str) -> tuple[float, float]:
    """Signs of the force's slope over slip angle and over camber in a table of these axes."""
    slip, force = AXES[axes]
    return -slip * force, -force


def _check_axes(path: Path, raw: MeasuredTyre, axes: str) -> None:
    """Refuse a table whose signs are not those of its axes, with the axes that they are of."""
    slopes, deviations = raw.linear()
    by_slip, by_camber = np.sign(slopes[1]), np.sign(slopes[2])
    told = bool(np.ptp(raw.camber) > 0.0) and abs(slopes[2]) > TOLD * deviations[2]
    fitting = [
        name
        for name in AXES
        if _signs(name)[0] == by_slip and (not told or _signs(name)[1] == by_camber)
    ]
    if axes in fitting:
        return
    words = {1.0: "rises", -1.0: "falls", 0.0: "does not change"}
    said = f"lateral force {words[float(by_slip)]} with the slip angle"
    if told:
        said += f" and {words[float(by_camber)]} with the camber"
    if fitting:
        raise CanrollError(f"{path}: {said}, not as in {axes} axes: give --axes {fitting[0]}")
    raise CanrollError(f"{path}: {said}, as in no usual axes: reverse the sign of one column")


def levels(values: Vector, share: float = 0.05) -> NDArray[np.int64]:
    """Return the number of the level that each value belongs to, the lowest first (n).

    Levels lie apart by more than ``share`` of the largest value.
    """
    order = np.argsort(values, kind="stable")
    jumps = np.diff(values[order]) > share * np.abs(values).max()
    result = np.empty(len(values), dtype=np.int64)
    result[order] = np.concatenate([[0], np.cumsum(jumps)])
    return result
