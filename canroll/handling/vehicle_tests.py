"""Handling of a vehicle, from Python: understeer, frequency response, limit of a manoeuvre."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from canroll import vehicles
from canroll.arguments import checked
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim import bodies
from canroll.plant_sim.driving import maneuvers, standards
from canroll.plant_sim.driving.limit import Limited, limited_by
from canroll.plant_sim.world import handling
from canroll.plant_sim.world.handling import FrequencyResponse, SpeedLimit, Understeer
from canroll.runs import experiment
from canroll.runs.result import Run
from canroll.setup.choices import PASSIVE, Choices
from canroll.setup.controller import Controller
from canroll.table import Table
from canroll.vehicles import Vehicle
from canroll.vehicles.unladen import unladen

JUDGED = ("double_lane_change", "fishhook", "j_turn", "moose", "sine_with_dwell")
"""Manoeuvres that have criteria to pass or fail by."""
LOADS = ("laden", "empty")
NAMED = str | Path | Mapping[str, Any] | Vehicle
"""A vehicle: preset, file, table, or loaded."""


@checked
def understeer(vehicle: NAMED, *, radius: float = 100.0, plant: str = "nonlinear") -> Understeer:
    """Drive the constant-radius test of ISO 4138, without control.

    Args:
        vehicle: preset, file, table or vehicle.
        radius: of the circle, m.
        plant: simulated vehicle model.

    Returns:
        Gradients and steady turns; ``table`` has a row for each.

    Raises:
        CanrollError: an unknown vehicle or plant, or a radius below 20 m.
        VerdictError: the car does not reach a steady turn.
    """
    car, drive = alone(vehicle, plant)
    return handling.constant_radius(car, drive, radius=radius)


def alone(vehicle: NAMED, plant: str, load: str = LOADS[0]) -> tuple[Vehicle, handling.Drive]:
    """Return a vehicle with its load, and how it is driven without control.

    Raises:
        CanrollError: an unknown vehicle, plant or load.
    """
    if load not in LOADS:
        raise UnknownNameError("load", load, LOADS)
    body = bodies.own_body(plant, "a test of vehicles")
    car = loaded(vehicles.load(vehicle), load)
    return car, handling.passive(car, body)


def loaded(vehicle: Vehicle, load: str) -> Vehicle:
    """Return a vehicle with one of :data:`LOADS`."""
    return unladen(vehicle) if load == "empty" else vehicle


@checked
def response(
    vehicle: NAMED,
    *,
    speed_kmh: float = 100.0,
    lateral_acceleration: float = 2.0,
    load: str = "laden",
    plant: str = "nonlinear",
) -> FrequencyResponse:
    """Drive the frequency-response test of ISO 7401, without control.

    Args:
        vehicle: preset, file, table or vehicle.
        speed_kmh: km/h.
        lateral_acceleration: of the steady state of the steering's amplitude, m/s²; at most 4.
        load: "laden" or "empty".
        plant: simulated vehicle model.

    Returns:
        Complex response of yaw rate, lateral acceleration and roll; ``table`` has gain and phase.

    Raises:
        CanrollError: an unknown vehicle, plant or load, or a speed beyond 20 to 200 km/h.
        VerdictError: the car rolls over.
    """
    check_speed(speed_kmh)
    car, drive = alone(vehicle, plant, load)
    return handling.frequency_response(
        car, drive, speed=speed_kmh / 3.6, lateral_acceleration=lateral_acceleration
    )


def check_speed(speed_kmh: float) -> None:
    """Reject a speed at which the frequency response is not driven."""
    if not 20.0 <= speed_kmh <= 200.0:
        raise CanrollError(f"speed {speed_kmh:g} km/h: must be 20 to 200 km/h")


@dataclass(frozen=True, slots=True)
class DrivenLimit:
    """Limit of the car without or with control, and what limited the slowest failed run."""

    speeds: SpeedLimit
    limited: Limited | None

    @property
    def sentence(self) -> str:
        """The limit in words."""
        passed, failed = self.speeds.passed, self.speeds.failed
        if passed is None:
            text = f"fails already at {(failed or 0.0) * 3.6:.1f} km/h"
        elif failed is None:
            text = f"passes up to {passed * 3.6:.1f} km/h, the fastest tried"
        else:
            text = f"passes up to {passed * 3.6:.1f} km/h, fails at {failed * 3.6:.1f}"
        if self.limited is None:
            return text
        return f"{text}; limited by the {self.limited.by}: {self.limited.reason}"

    def to_json(self) -> dict[str, Any]:
        """Return the speeds in km/h, and what limited."""
        speeds = {"passed_kmh": self.speeds.passed, "failed_kmh": self.speeds.failed}
        return {
            **{name: v if v is None else round(v * 3.6, 3) for name, v in speeds.items()},
            "limited_by": self.limited and self.limited.by,
            "reason": self.limited and self.limited.reason,
        }


@dataclass(frozen=True, slots=True, repr=False)
class ManoeuvreLimit:
    """Highest entry speed at which a manoeuvre's criteria are met.

    Attributes:
        settings: of the manoeuvre.
        bracket: lowest and highest speed that were tried, km/h.
        runs: "passive" and, but for the law "passive", "controlled".
    """

    settings: Run
    bracket: tuple[float, float]
    runs: Mapping[str, DrivenLimit]

    @property
    def table(self) -> Table:
        """One row for each run."""
        return Table([{"run": name, **one.to_json()} for name, one in self.runs.items()])

    def __repr__(self) -> str:
        limits = "; ".join(f"{name} {one.sentence}" for name, one in self.runs.items())
        return f"<{self.settings.scenario}, {self.settings.vehicle_name}: {limits}>"

    def to_json(self) -> dict[str, Any]:
        """Return the object printed by ``canroll handling limit --json``."""
        settings = self.settings
        return {
            "scenario": settings.scenario,
            **settings.vehicles,
            "law": settings.law,
            "plant": settings.plant,
            "from_kmh": self.bracket[0],
            "to_kmh": round(self.bracket[1], 6),
            "controlled": None,
            **{name: one.to_json() for name, one in self.runs.items()},
        }


@checked
def limit(
    scenario: str,
    *,
    low_kmh: float = 30.0,
    high_kmh: float | None = None,
    tolerance_kmh: float = 0.5,
    **choices: Unpack[Choices],
) -> ManoeuvreLimit:
    """Bisect the entry speed of a manoeuvre for the highest that meets its criteria.

    Args:
        scenario: one of :data:`JUDGED`.
        low_kmh: lowest speed, km/h.
        high_kmh: highest speed, km/h; None: the fastest of the manoeuvre.
        tolerance_kmh: final bracket, km/h.
        choices: as for :func:`canroll.run`.

    Raises:
        CanrollError: a manoeuvre without criteria, an empty bracket, or an invalid choice.
        VerdictError: the design fails its own checks.
    """
    slowest, fastest = (speed * 3.6 for speed in maneuvers.speed_range(scenario))
    if scenario not in JUDGED:
        raise CanrollError(f"{scenario} has no pass criterion: choose {', '.join(JUDGED)}")
    high = fastest if high_kmh is None else high_kmh
    if not slowest <= low_kmh < high <= fastest + 1e-6:
        raise CanrollError(
            f"speeds {low_kmh:g} to {high:g} km/h: {scenario} is driven at {slowest:g} to "
            f"{fastest:g} km/h, and --from must lie below --to"
        )
    if not 0.01 <= tolerance_kmh <= high - low_kmh:
        raise CanrollError(f"tolerance {tolerance_kmh:g} km/h: must lie in 0.01 to the range")
    settings, controller = experiment.plan(scenario, **choices)
    bracket = low_kmh, high
    names = ("passive",) if settings.law == PASSIVE else ("passive", "controlled")
    runs = {}
    for name in names:
        enabled = name == "controlled"
        speeds = find(settings, controller, enabled=enabled, bracket=bracket, within=tolerance_kmh)
        runs[name] = DrivenLimit(speeds, _reason(settings, controller, speeds, enabled=enabled))
    return ManoeuvreLimit(settings, bracket, runs)


def find(
    settings: Run,
    controller: Controller,
    *,
    enabled: bool,
    bracket: tuple[float, float],
    within: float,
) -> SpeedLimit:
    """Bisect the entry speed in ``bracket``, to ``within``; all in km/h."""

    def fails(speed: float) -> bool:
        trace = experiment.drive(replace(settings, speed=speed), controller, enabled=enabled)
        if trace.signals["rollover"].max() > 0:
            return True
        verdicts = standards.judge(settings.scenario, settings.vehicle, trace.signals)
        return not all(verdict.passed for verdict in verdicts)

    low, high = (speed / 3.6 for speed in bracket)
    return handling.bisect_speed(fails, low=low, high=high, tolerance=within / 3.6)


def _reason(
    settings: Run, controller: Controller, speeds: SpeedLimit, *, enabled: bool
) -> Limited | None:
    """Return what limited the slowest failed run; None if none failed."""
    if speeds.failed is None:
        return None
    trace = experiment.drive(replace(settings, speed=speeds.failed), controller, enabled=enabled)
    common = maneuvers.options(settings.scenario)["friction"]
    friction = float(dict(settings.options).get("friction", common))
    return limited_by(settings.vehicle, trace.signals, friction)
