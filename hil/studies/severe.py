"""Severe manoeuvres over a population: the law compared with plain feedforward and a passive bar.

Every manoeuvre is driven by the same vehicles with the same noise, so that every ratio is paired.
The law runs as it was designed, the plain feedforward at the law's RMS moment in a double lane
change, and the passive bar is the best of that lane change
(:func:`hil.studies.equal_effort.compare`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.arguments import checked
from canroll.errors import CanrollError
from canroll.table import Table
from canroll.typing import Progress
from hil.runs.choices import OF_ONE_MANOEUVRE, PASSIVE, check, chosen
from hil.runs.experiment import drive, limit_cycle_of, plan
from hil.runs.frozen import Controller
from hil.runs.metrics import peak, rms
from hil.runs.result import Settings
from hil.runs.trace import Trace
from hil.studies import equal_effort
from hil.studies.effort import scaled
from hil.studies.equal_effort import Entry, paired, with_stiffer_bar
from hil.studies.variation import population, spread_from
from plant_sim.bodies import own_body

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
class Row:
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
class Study:
    """All rows, and the origin of the compared controllers."""

    rows: tuple[Row, ...]
    law: str
    vehicles: Mapping[str, str | None]
    actuator: str
    bus: str
    runs: int
    effort: float
    bar: float

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
    progress: Progress | None = None,
    **choices: Any,  # noqa: ANN401
) -> Study:
    """Drive every manoeuvre ``runs`` times with every controller.

    Args:
        runs: vehicles of the population, at least 2.
        spread: shares of the population by quantity; those left out are the usual ones, see
            :mod:`hil.studies.variation`.
        manoeuvres: manoeuvres to drive.
        progress: called with the current activity and the fraction done.
        choices: vehicle, law, bus and actuator of :class:`hil.runs.choices.Choices`.

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
    spread = spread_from(spread or {})
    law = chosen(choices, "law")
    common = {name: value for name, value in choices.items() if name != "law"}
    lane_change = equal_effort.compare(
        LANE_CHANGE,
        vehicle=chosen(choices, "vehicle"),
        bus=chosen(choices, "bus"),
        runs=runs,
        entries=(
            Entry("passive", "", {"law": PASSIVE}, scaled=False),
            Entry(BAR, "", {"law": PASSIVE}, scaled=False, best_bar=True),
            Entry(law, "", {"law": law}),
            Entry(PLAIN, "", {"law": PLAIN}),
        ),
        reference=law,
        spread=spread,
        conditions={k: v for k, v in common.items() if k not in ("vehicle", "bus")},
    )
    factors = {row.entry.name: row.factor for row in lane_change.rows}
    rows: list[Row] = []
    for done, manoeuvre in enumerate(manoeuvres):
        if progress is not None:
            progress("severe manoeuvres", done / len(manoeuvres))
        own = {"speed_kmh": manoeuvre.speed_kmh, "options": manoeuvre.options}
        rows += _Course(manoeuvre, {**common, **own}, runs, spread).rows(law, factors)
    settings = plan(LANE_CHANGE, **choices)[0]
    own_body(settings.plant, "a population of vehicles")
    return Study(
        tuple(rows),
        law,
        settings.vehicles,
        settings.actuator,
        settings.bus,
        runs,
        lane_change.budget,
        factors[BAR],
    )


@dataclass(frozen=True, slots=True)
class _Course:
    """One manoeuvre for all controllers: common choices, the population and its passive runs."""

    manoeuvre: Severe
    keywords: Mapping[str, Any]
    runs: int
    spread: Mapping[str, float]
    without: list[Trace] = field(default_factory=list)

    def rows(self, law: str, factors: Mapping[str, float]) -> Iterator[Row]:
        """Yield the rows; ``factors`` are those on the laws' moment and on the bar's stiffness."""
        settings, controller = plan(self.manoeuvre.scenario, **self.keywords, law=PASSIVE)
        self.without[:] = self._drive(settings, controller, enabled=False)
        passive = np.array([_figures(trace) for trace in self.without])
        yield Row(self.manoeuvre, "passive", passive, passive, 0)
        stiffer = with_stiffer_bar(settings, factors[BAR])
        barred = [_figures(trace) for trace in self._drive(stiffer, controller, enabled=False)]
        yield Row(self.manoeuvre, BAR, np.array(barred), passive, 0)
        for name in (PLAIN, law):
            settings, controller = plan(self.manoeuvre.scenario, **self.keywords, law=name)
            if factors[name] != 1.0:
                controller = scaled(controller, factors[name])
            figures, cycles = [], 0
            for where, without in zip(
                population(settings, self.runs, self.spread), self.without, strict=True
            ):
                trace = drive(where, controller, enabled=True)
                figures.append(_figures(trace))
                cycle = limit_cycle_of(where, controller, trace, without.signals)
                cycles += cycle is not None
            yield Row(self.manoeuvre, name, np.array(figures), passive, cycles)

    def _drive(
        self, settings: Settings, controller: Controller, *, enabled: bool
    ) -> Iterator[Trace]:
        for where in population(settings, self.runs, self.spread):
            yield drive(where, controller, enabled=enabled)


def _figures(trace: Trace) -> tuple[float, float, float, float]:
    signals = trace.signals
    sideslip = np.arctan2(signals["vy"], signals["vx"])
    return (
        degrees(rms(signals["roll"])),
        degrees(peak(signals["roll"])),
        degrees(peak(sideslip)),
        float(np.any(signals["two_wheel_lift"] > 0)),
    )


HEAD = (
    *("manoeuvre", "", "roll max", "against passive [95 %]", "worst vehicle", "roll RMS"),
    *("sideslip max", "both wheels of a side off", "limit cycles"),
)


def lines(found: Study) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the study as texts under :data:`HEAD`, better and worse results alike."""
    for row in found.rows:
        first = row.manoeuvre.title if row.name == "passive" else ""
        against, worst = "", ""
        if row.name != "passive":
            column = FIGURES.index("roll_max")
            ratio = paired(row.figures[:, column], row.passive[:, column])
            mean, low, high = (100 * value for value in (ratio.mean, ratio.low, ratio.high))
            against = f"{mean:+.0f} % [{low:+.1f}, {high:+.1f}]"
            worst = f"{100 * row.worst:+.0f} %"
        yield (
            *(first, row.name, f"{row.mean('roll_max'):.2f}°", against, worst),
            *(f"{row.mean('roll_rms'):.2f}°", f"{row.mean('sideslip_max'):.1f}°"),
            *(f"{row.lifts} of {found.runs}", f"{row.cycles} of {found.runs}"),
        )


def markdown(found: Study) -> list[str]:
    """Return the study as a Markdown table."""
    rule = " | ".join("---" if name in ("", *HEAD[:4:3]) else "---:" for name in HEAD)
    head = " | ".join(HEAD).replace("|  |", "| |")
    return [f"| {head} |", f"| {rule} |", *(f"| {' | '.join(row)} |" for row in lines(found))]


def to_json(found: Study) -> dict[str, Any]:
    """Return the study as plain data."""
    return {
        "law": found.law,
        **found.vehicles,
        "actuator": found.actuator,
        "bus": found.bus,
        "runs": found.runs,
        "effort_nm": found.effort,
        "bar_factor": found.bar,
        "rows": list(found.table),
    }


def _values(row: Row) -> dict[str, Any]:
    return {
        "manoeuvre": row.manoeuvre.title,
        "name": row.name,
        **{f"{figure}_deg": row.mean(figure) for figure in FIGURES[:3]},
        "two_wheel_lifts": row.lifts,
        "limit_cycles": row.cycles,
        "worst": row.worst,
    }
