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
from canroll.report.page import PageTable
from canroll.runs.experiment import drive, limit_cycle_of, plan
from canroll.runs.metrics import peak, rms
from canroll.runs.result import Run
from canroll.setup.choices import OF_ONE_MANOEUVRE, PASSIVE, check, chosen
from canroll.setup.controller import Controller
from canroll.studies import equal_effort
from canroll.studies.effort import scaled
from canroll.studies.effort_rows import EffortEntry, with_stiffer_bar
from canroll.studies.equal_effort import Difference, paired
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
FIGURES = ("roll_rms_deg", "roll_max_deg", "sideslip_max_deg", "two_wheel_lifts", "limit_cycles")
"""Of a run: three angles, whether both wheels of a side left the road, and a limit cycle."""
HEAD = (
    *("manoeuvre", "", "roll max", "against passive [95 %]", "worst vehicle", "roll RMS"),
    *("sideslip max", "both wheels of a side off", "limit cycles"),
)
OF_FILE = (
    "the vehicles are spread by --spread about the numbers of {}'s file, not drawn from its [fit], "
    "which the designs allow for: canroll campaign draws from it"
)


@dataclass(frozen=True, slots=True)
class SevereStudy:
    """What was compared, by the keys of the JSON object, and its rows.

    ``against``: for each row the paired difference of the largest roll angles from the passive
    vehicle.
    """

    about: Mapping[str, Any]
    table: Table
    against: Sequence[Difference]

    def __repr__(self) -> str:
        return f"<{self.about['law']} for {self.about['vehicle']}: {len(self.table)} rows>"

    def to_json(self) -> dict[str, Any]:
        """Return the study as plain data."""
        return {**self.about, "rows": list(self.table)}

    def shown(self) -> PageTable:
        """Return the study as texts, better and worse results alike."""
        runs, rows = self.about["runs"], []
        for row, one in zip(self.table, self.against, strict=True):
            first, against, worst = row["manoeuvre"], "", ""
            if row["name"] != "passive":
                interval = f" [{100 * one.low:+.1f}, {100 * one.high:+.1f}]" * (runs > 1)
                first, against = "", f"{100 * one.mean:+.0f} %{interval}"
                worst = f"{100 * row['worst']:+.0f} %"
            rows.append(
                (
                    *(first, row["name"], f"{row['roll_max_deg']:.2f}°", against, worst),
                    *(f"{row['roll_rms_deg']:.2f}°", f"{row['sideslip_max_deg']:.1f}°"),
                    *(f"{row[key]} of {runs}" for key in FIGURES[3:]),
                )
            )
        return PageTable("", HEAD, rows)


def summarised(
    where: Severe, cars: Sequence[str], figures: NDArray[np.float64]
) -> Iterator[tuple[dict[str, Any], Difference]]:
    """Yield row and difference of each car from the :data:`FIGURES`, (vehicles, cars, 5)."""
    peaks = figures[..., FIGURES.index("roll_max_deg")]
    for place, name in enumerate(cars):
        mean, count = figures[:, place].mean(axis=0), figures[:, place].sum(axis=0)
        row: dict[str, Any] = {"manoeuvre": where.title, "name": name}
        row |= {key: float(mean[k]) for k, key in enumerate(FIGURES[:3])}
        row |= {key: int(count[k]) for k, key in enumerate(FIGURES[3:], 3)}
        row["worst"] = float(np.max(peaks[:, place] / peaks[:, 0])) - 1.0
        yield row, paired(peaks[:, place], peaks[:, 0])


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
    rows = [
        row
        for place, values in figures.items()
        for row in summarised(manoeuvres[place], tuple(cars), np.array(values))
    ]
    settings = controlled[0]
    about = {
        "law": law,
        **settings.vehicles,
        "actuator": settings.actuator,
        "bus": settings.bus,
        "runs": runs if cases.execution.only is None else 1,
        "effort_nm": lane_change.budget,
        "bar_factor": factors[BAR],
    }
    if settings.vehicle.fit is not None:
        about["note"] = OF_FILE.format(settings.vehicle.name)
    return SevereStudy(about, Table([row for row, _ in rows]), [one for _, one in rows])


def drive_all(
    fleet: Sequence[tuple[Run, Controller]],
    where: Severe,
    index: int,
    spread: Mapping[str, float],
) -> tuple[tuple[float, ...], ...]:
    """Return the figures of a vehicle with each controller, and whether there is a limit cycle.

    ``fleet``: settings of the lane change and controller, the first of the passive vehicle.
    """
    rows = []
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
        signals = trace.signals
        sideslip = np.arctan2(signals["vy"], signals["vx"])
        angles = rms(signals["roll"]), peak(signals["roll"]), peak(sideslip)
        lifts = float(np.any(signals["two_wheel_lift"] > 0))
        rows.append((*map(degrees, angles), lifts, float(cycle is not None)))
    return tuple(rows)
