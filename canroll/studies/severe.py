"""Severe manoeuvres over a population: the law compared with plain feedforward and a passive bar.

Every manoeuvre is driven by the same vehicles with the same noise, so that every ratio is paired.
The law runs as it was designed, the plain feedforward at the law's RMS moment in a double lane
change, and the passive bar is the best of that lane change
(:func:`canroll.studies.equal_effort.compare`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.arguments import checked
from canroll.cases.execution import IN_TURN, Cases
from canroll.cases.identity import identity
from canroll.errors import CanrollError
from canroll.runs.experiment import drive, limit_cycle_of, plan
from canroll.runs.metrics import peak, rms
from canroll.runs.result import Settings
from canroll.runs.trace import Trace
from canroll.setup.choices import OF_ONE_MANOEUVRE, PASSIVE, check, chosen
from canroll.setup.controller import PreparedController
from canroll.studies import equal_effort
from canroll.studies.effort import scaled
from canroll.studies.effort_rows import EffortEntry, with_stiffer_bar
from canroll.studies.equal_effort import paired
from canroll.studies.variation import draw, spread_from
from canroll.table import Table

LANE_CHANGE = "double_lane_change"
PLAIN, BAR = "plain_feedforward", "best passive bar"


@dataclass(frozen=True, slots=True)
class Severe:
    """One manoeuvre at its speed, km/h."""

    scenario: str
    speed_kmh: float
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The manoeuvre in words."""
        more = "".join(f", {name} {value:g}" for name, value in self.options.items())
        return f"{self.scenario.replace('_', ' ')} {self.speed_kmh:g} km/h{more}"


MANOEUVRES = (
    Severe(LANE_CHANGE, 80.0),
    Severe(LANE_CHANGE, 100.0),
    Severe(LANE_CHANGE, 80.0, {"friction": 0.6}),
    Severe(LANE_CHANGE, 60.0, {"friction": 0.35}),
    Severe("moose", 60.0, {"friction": 1.0}),
    Severe("sine_with_dwell", 80.0, {"scale": 2.5}),
    Severe("sine_with_dwell", 80.0, {"scale": 3.5}),
    Severe("sine_with_dwell", 80.0, {"scale": 5.0}),
    Severe("j_turn", 60.0),
    Severe("fishhook", 60.0),
    Severe("fishhook", 80.0),
    Severe("bumps", 40.0),
)
"""Lateral accelerations of van_real: 0.3 g on friction 0.35, 0.4 g on 0.6, 0.4 to 0.6 g in lane
changes that the driver steers, 0.7, 0.8 and 0.9 g in those of the robot, 0.9 g in the turns."""
FIGURES = ("roll_rms", "roll_max", "sideslip_max", "two_wheel_lift")
"""Of a run: deg, deg, deg, and whether both wheels of a side left the road."""


@dataclass(frozen=True, slots=True)
class SevereRow:
    """One controller, or none, in one manoeuvre.

    Attributes:
        manoeuvre: the manoeuvre.
        name: law, "passive" or "best passive bar".
        figures: runs by :data:`FIGURES`.
        passive: the same figures without control.
        cycles: runs with a limit cycle.
    """

    manoeuvre: Severe
    name: str
    figures: NDArray[np.float64]
    passive: NDArray[np.float64]
    cycles: int

    def mean(self, figure: str) -> float:
        """Mean of a figure."""
        return float(np.mean(self.figures[:, FIGURES.index(figure)]))

    @property
    def lifts(self) -> int:
        """Runs in which both wheels of a side left the road."""
        return int(np.sum(self.figures[:, FIGURES.index("two_wheel_lift")]))

    @property
    def worst(self) -> float:
        """Largest ratio of a vehicle's peak roll angle to that without control, minus 1."""
        column = FIGURES.index("roll_max")
        return float(np.max(self.figures[:, column] / self.passive[:, column])) - 1.0


@dataclass(frozen=True, slots=True)
class SevereStudy:
    """All rows, and the origin of the compared controllers; ``note``: on the cars, or empty."""

    rows: tuple[SevereRow, ...]
    law: str
    vehicles: Mapping[str, str | None]
    actuator: str
    bus: str
    runs: int
    effort: float
    bar: float
    note: str

    @property
    def table(self) -> Table:
        """One row for each controller in each manoeuvre."""
        return Table([_values(row) for row in self.rows])


@checked
def study(
    *,
    runs: int = 10,
    spread: Mapping[str, float | str] | None = None,
    manoeuvres: Sequence[Severe] = MANOEUVRES,
    cases: Cases = IN_TURN,
    **choices: Any,  # noqa: ANN401
) -> SevereStudy:
    """Drive every manoeuvre ``runs`` times with every controller.

    Args:
        runs: vehicles of the population, at least 2.
        spread: shares of the population by quantity; those left out are the usual ones, see
            :mod:`canroll.studies.variation`.
        manoeuvres: manoeuvres to drive.
        cases: what drives the cases, a manoeuvre and a vehicle each.
        choices: vehicle, law, bus and actuator of :class:`canroll.setup.choices.Choices`.

    Raises:
        CanrollError: an invalid name or number, or a law that cannot be driven.
    """
    if runs < 2:
        raise CanrollError(f"runs={runs}: must be at least 2")
    check(choices)
    for name in OF_ONE_MANOEUVRE:
        if choices.get(name) is not None:
            raise CanrollError(
                f"{name}: does not apply to several manoeuvres and vehicles: omit it"
            )
    shares = spread_from(spread or {})
    pairs = cases.picked([(place, i) for place in range(len(manoeuvres)) for i in range(runs)])
    law = chosen(choices, "law")
    common = {name: value for name, value in choices.items() if name != "law"}
    lane_change = equal_effort.compare(
        LANE_CHANGE,
        vehicle=chosen(choices, "vehicle"),
        bus=chosen(choices, "bus"),
        runs=runs,
        entries=(
            EffortEntry("passive", "", {"law": PASSIVE}, scaled=False),
            EffortEntry(BAR, "", {"law": PASSIVE}, scaled=False, best_bar=True),
            EffortEntry(law, "", {"law": law}),
            EffortEntry(PLAIN, "", {"law": PLAIN}),
        ),
        reference=law,
        spread=shares,
        conditions={k: v for k, v in common.items() if k not in ("vehicle", "bus")},
        cases=replace(cases, execution=replace(cases.execution, only=None)),
    )
    factors = {row.entry.name: row.factor for row in lane_change.rows}
    passive, plain, controlled = (
        plan(LANE_CHANGE, **common, law=name) for name in (PASSIVE, PLAIN, law)
    )
    cars = {
        "passive": passive,
        BAR: (with_stiffer_bar(passive[0], factors[BAR]), passive[1]),
        PLAIN: (plain[0], scaled(plain[1], factors[PLAIN])),
        law: (controlled[0], scaled(controlled[1], factors[law])),
    }
    kept = cases.of(
        identity(*controlled) | {"runs": runs, "spread": shares, "manoeuvres": manoeuvres}
    )
    fleet = kept.engine.common(list(cars.values()))
    arguments = [(fleet, manoeuvres[place], index, shares) for place, index in pairs]
    figures: dict[int, list[Any]] = {}
    driven = kept.rows("severe manoeuvres", drive_all, arguments)
    for (place, _), of_vehicle in zip(pairs, driven, strict=True):
        figures.setdefault(place, []).append(of_vehicle)
    settings = controlled[0]
    return SevereStudy(
        tuple(
            row
            for place, values in figures.items()
            for row in _rows(manoeuvres[place], tuple(cars), np.array(values))
        ),
        law,
        settings.vehicles,
        settings.actuator,
        settings.bus,
        runs if cases.execution.only is None else 1,
        lane_change.budget,
        factors[BAR],
        "" if settings.vehicle.fit is None else OF_FILE.format(settings.vehicle.name),
    )


def _rows(where: Severe, names: Sequence[str], values: NDArray[np.float64]) -> Iterator[SevereRow]:
    """Yield the rows of a manoeuvre from what :func:`drive_all` found of its vehicles."""
    for place, name in enumerate(names):
        own = values[:, place]
        yield SevereRow(where, name, own[:, :-1], values[:, 0, :-1], int(np.sum(own[:, -1])))


def drive_all(
    fleet: Sequence[tuple[Settings, PreparedController]],
    where: Severe,
    index: int,
    spread: Mapping[str, float],
) -> tuple[tuple[float, ...], ...]:
    """Return the figures of a vehicle with each controller, and whether there is a limit cycle.

    ``fleet``: settings of the lane change and controller, the first of the passive vehicle.
    """
    rows: list[tuple[float, ...]] = []
    without: Mapping[str, NDArray[np.float64]] = {}
    for nominal, controller in fleet:
        there = replace(
            nominal,
            scenario=where.scenario,
            speed=where.speed_kmh / 3.6,
            options=tuple(sorted(where.options.items())),
        )
        settings = draw(there, index, spread=spread, seed=0)
        active = settings.law != PASSIVE
        trace = drive(settings, controller, enabled=active)
        without = without or trace.signals
        cycle = limit_cycle_of(settings, controller, trace, without) if active else None
        rows.append((*_figures(trace), float(cycle is not None)))
    return tuple(rows)


def _figures(trace: Trace) -> tuple[float, float, float, float]:
    signals = trace.signals
    sideslip = np.arctan2(signals["vy"], signals["vx"])
    return (
        degrees(rms(signals["roll"])),
        degrees(peak(signals["roll"])),
        degrees(peak(sideslip)),
        float(np.any(signals["two_wheel_lift"] > 0)),
    )


OF_FILE = (
    "the vehicles are spread by --spread about the numbers of {}'s file, not drawn from its [fit], "
    "which the designs allow for: canroll campaign draws from it"
)


HEAD = (
    *("manoeuvre", "", "roll max", "against passive [95 %]", "worst vehicle", "roll RMS"),
    *("sideslip max", "both wheels of a side off", "limit cycles"),
)


def lines(answer: SevereStudy) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the study as texts under :data:`HEAD`, better and worse results alike."""
    for row in answer.rows:
        first = row.manoeuvre.title if row.name == "passive" else ""
        against, worst = "", ""
        if row.name != "passive":
            column = FIGURES.index("roll_max")
            ratio = paired(row.figures[:, column], row.passive[:, column])
            mean, low, high = (100 * value for value in (ratio.mean, ratio.low, ratio.high))
            against = f"{mean:+.0f} %"
            against += f" [{low:+.1f}, {high:+.1f}]" if answer.runs > 1 else ""
            worst = f"{100 * row.worst:+.0f} %"
        yield (
            *(first, row.name, f"{row.mean('roll_max'):.2f}°", against, worst),
            *(f"{row.mean('roll_rms'):.2f}°", f"{row.mean('sideslip_max'):.1f}°"),
            *(f"{row.lifts} of {answer.runs}", f"{row.cycles} of {answer.runs}"),
        )


def markdown(answer: SevereStudy) -> list[str]:
    """Return the study as a Markdown table."""
    rule = " | ".join("---" if name in ("", *HEAD[:4:3]) else "---:" for name in HEAD)
    head = " | ".join(HEAD).replace("|  |", "| |")
    return [f"| {head} |", f"| {rule} |", *(f"| {' | '.join(row)} |" for row in lines(answer))]


def to_json(answer: SevereStudy) -> dict[str, Any]:
    """Return the study as plain data."""
    return {
        "law": answer.law,
        **answer.vehicles,
        "actuator": answer.actuator,
        "bus": answer.bus,
        "runs": answer.runs,
        "effort_nm": answer.effort,
        "bar_factor": answer.bar,
        "rows": list(answer.table),
        **({"note": answer.note} if answer.note else {}),
    }


def _values(row: SevereRow) -> dict[str, Any]:
    return {
        "manoeuvre": row.manoeuvre.title,
        "name": row.name,
        **{f"{figure}_deg": row.mean(figure) for figure in FIGURES[:3]},
        "two_wheel_lifts": row.lifts,
        "limit_cycles": row.cycles,
        "worst": row.worst,
    }
