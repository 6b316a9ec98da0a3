"""The plots of runs, the same for every run, so that several can be overlaid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from canroll.plant_sim.bodies.ports import AXLES, WHEELS
from canroll.plant_sim.world.spool import blocks, pieces, row_count
from canroll.report.figure import (
    DASH_DOTTED,
    DASHED,
    DOTTED,
    OVERVIEW,
    POINTS_MAX,
    SOLID,
    Figure,
    Series,
    distribution,
    histogram,
    thin_pieces,
)
from canroll.runs.metrics import (
    MOMENTS,
    has_wheel_loads,
    load_transfer,
    loads_of,
    response_times,
)
from canroll.runs.trace import Trace
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle

PASSIVE_COLOUR = 0
CONES_COLOUR = 2
LOAD_WINDOW = 0.1
FIRST = ("roll", "moment", "ay")
"""Plots that stand below the verdict."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One run on the page: its name in legends, its colour, and whether the ECU was in control."""

    name: str
    trace: Trace
    colour: int
    controlled: bool

    @property
    def dash(self) -> int:
        """Dashes of its curves, so that coinciding curves remain visible."""
        return dash(self.colour) if self.controlled else DASHED


def dash(place: int) -> int:
    """Return the dashes of curve number ``place``, from 1."""
    return (SOLID, DASH_DOTTED, DOTTED)[(place - 1) % 3]


@dataclass(frozen=True, slots=True)
class CurveQuantity:
    """What is plotted: a function of recorded ``signals`` that takes each instant separately."""

    signals: tuple[str, ...]
    of: Callable[..., Vector]

    def curve(self, trace: Trace, points: int = POINTS_MAX) -> tuple[Vector, Vector]:
        """Return times (s) and values of a run, thinned by :func:`canroll.report.figure.thin`."""
        recorded = pieces(trace.signals, "time", *self.signals)
        values = ((time, self.of(*columns)) for time, *columns in recorded)
        return thin_pieces(values, row_count(trace.signals), points)


def signal(name: str, scale: float = 1.0) -> CurveQuantity:
    """Return a recorded signal, times ``scale``."""
    return CurveQuantity((name,), lambda values: values * scale)


def transfer(axle: str) -> CurveQuantity:
    """Return the load transfer of an axle."""
    return CurveQuantity(loads_of(axle), load_transfer)


MOMENT = CurveQuantity(MOMENTS, np.add)
"""Anti-roll moment on the body from the actuators, N·m."""
EFFECTIVE = CurveQuantity(("ay", "bank"), lambda ay, bank: ay + GRAVITY * np.sin(bank))
"""Lateral acceleration as an accelerometer in the upright body measures it, m/s²."""


def _over_time(
    runs: Sequence[Shown], id: str, title: str, ylabel: str, quantity: CurveQuantity
) -> Figure:
    curves = [Series(run.name, *quantity.curve(run.trace), run.colour, run.dash) for run in runs]
    group = OVERVIEW if id in FIRST else "motion"
    return Figure(id, title, "time (s)", ylabel, curves, unit="s", group=group)


def motion(runs: Sequence[Shown]) -> list[Figure]:
    """Return roll angle and rate, lateral acceleration, load transfer of each axle."""
    degrees = float(np.degrees(1))
    loaded = all(has_wheel_loads(run.trace) for run in runs)
    plots = [
        ("roll", "Roll angle", "deg", signal("roll", degrees)),
        ("roll-rate", "Roll rate", "deg/s", signal("roll_rate", degrees)),
        *((f"nlt-{a}", f"Load transfer, {a} axle", "−1 to 1", transfer(a)) for a in AXLES),
        ("ay", "Lateral acceleration", "m/s²", signal("ay")),
        ("path-error", "Distance from the driver's path", "m", signal("path_error")),
        ("steer", "Steering at the road wheels", "deg", signal("steer", degrees)),
    ]
    return [
        _over_time(runs, id, title, unit, quantity)
        for id, title, unit, quantity in plots
        if loaded or not id.startswith("nlt")
    ]


def control(runs: Sequence[Shown]) -> list[Figure]:
    """Return moments, forces and the estimate of each controlled run."""
    plots: list[Figure] = []
    active = [run for run in runs if run.controlled]
    if not active:
        return plots
    moments: list[Series] = []
    for row, run in enumerate(active):
        ticks, more = run.trace.ticks, f", {run.name}" if len(active) > 1 else ""
        moments += [
            Series(f"commanded{more}", ticks["t"], ticks["moment"], run.colour, DOTTED, "step"),
            Series(
                f"delivered{more}",
                *MOMENT.curve(run.trace),
                run.colour if len(active) > 1 else 2,
            ),
        ]
        instants = ticks["t"][ticks["triggered"] == 1]
        beats = ticks["t"][ticks["triggered"] == 2]
        moments.append(_marks(f"sent on trigger{more}", instants, run.colour, 2 * row))
        moments.append(_marks(f"heartbeat{more}", beats, 5, 2 * row + 1))
    plots.append(
        Figure(
            "moment",
            "Anti-roll moment",
            "time (s)",
            "N·m",
            moments,
            unit="s",
            group=OVERVIEW,
            note="marks at the foot: commands put on the bus",
        )
    )
    for run in active:
        more = f", {run.name}" if len(active) > 1 else ""
        suffix = f"-{run.colour}" if len(active) > 1 else ""
        plots.append(_forces(run, more, suffix))
        plots += _loads([*(other for other in runs if not other.controlled), run], more, suffix)
        plots += _estimates(run, more, suffix)
    return plots


def _marks(name: str, instants: Vector, colour: int, row: int) -> Series:
    return Series(name, instants, np.zeros(len(instants)), colour, kind="marks", row=row)


def _wheels(run: Shown, prefix: str) -> list[Series]:
    dashes = (SOLID, DASHED, DOTTED, DASH_DOTTED)
    return [
        Series(
            wheel.replace("_", " "),
            *signal(f"{prefix}_{wheel}").curve(run.trace),
            colour,
            dash,
        )
        for wheel, colour, dash in zip(WHEELS, (1, 2, 6, 4), dashes, strict=True)
    ]


def _forces(run: Shown, more: str, suffix: str) -> Figure:
    """Forces of the actuators on the body per corner, or moments of bars per axle."""
    curves, title, unit = _wheels(run, "corner_force"), f"Actuator forces{more}", "N"
    if not any(np.any(curve.y) for curve in curves):
        curves = [
            Series(f"{axle} axle", *signal(f"moment_{axle}").curve(run.trace), colour, dash)
            for axle, colour, dash in zip(AXLES, (1, 2), (SOLID, DASHED), strict=True)
        ]
        title, unit = f"Moments of the bars{more}", "N·m"
    return Figure(f"forces{suffix}", title, "time (s)", unit, curves, unit="s", group="control")


def _loads(runs: Sequence[Shown], more: str, suffix: str) -> list[Figure]:
    """Return the wheel loads of each axle, without and with control."""
    loaded = [run for run in runs if has_wheel_loads(run.trace)]
    return [
        Figure(
            f"loads-{axle}{suffix}", f"Wheel loads, {axle} axle{more}", "time (s)", "N",
            [
                Series(
                    f"{side}, {run.name}",
                    *signal(f"wheel_load_{axle}_{side}").curve(run.trace),
                    colour,
                    dashes[run.controlled],
                )
                for run in loaded
                for side, colour, dashes in (
                    ("left", 1, (DASHED, SOLID)), ("right", 2, (DOTTED, DASH_DOTTED)),
                )
            ],
            unit="s", group="control", zero=True,
        )
        for axle in AXLES
        if loaded
    ]  # fmt: skip


def _estimates(run: Shown, more: str, suffix: str) -> list[Figure]:
    """Estimates of roll and of a_y + g·bank, which a car cannot distinguish."""
    ticks = run.trace.ticks
    degrees = float(np.degrees(1))
    roll, rate = signal("roll", degrees), signal("roll_rate", degrees)
    lateral = "lateral_acceleration"
    plots = (
        ("estimate", "Roll angle", "deg", "roll", roll, degrees),
        ("estimate-rate", "Roll rate", "deg/s", "roll_rate", rate, degrees),
        ("estimate-ay", "Effective lateral acceleration", "m/s²", lateral, EFFECTIVE, 1.0),
    )
    return [
        Figure(
            f"{id}{suffix}", f"{title}, true and estimated{more}", "time (s)", unit,
            [
                Series("true", *true.curve(run.trace), PASSIVE_COLOUR),
                Series("estimated", ticks["t"], ticks[field] * scale, run.colour, DASHED, "step"),
            ],
            unit="s", group="control",
        )
        for id, title, unit, field, true, scale in plots
    ]  # fmt: skip


def path(runs: Sequence[Shown], cones: Vector) -> list[Figure]:
    """Return the paths seen from above, and the ``cones``, (n, 2) in m."""
    curves = []
    for run in runs:
        signals = run.trace.signals
        places = thin_pieces(((x, y) for x, y in pieces(signals, "x", "y")), row_count(signals))
        curves.append(Series(run.name, *places, run.colour, run.dash))
    if len(cones):
        curves.append(Series("cones", cones[:, 0], cones[:, 1], CONES_COLOUR, kind="points"))
    return [
        Figure(
            "path", "Path", "forward (m)", "left (m)", curves, unit="m", linked=False, equal=True
        )
    ]


def bus(runs: Sequence[Shown]) -> list[Figure]:
    """Return load of the bus over time, response times and sample-to-force ages.

    Only the last run is shown: the frames of the others differ only in payload.
    """
    run = runs[-1]
    loads = [
        Series(
            f"segment {segment}" if segment else "bus of the controller",
            *_load(run, segment),
            colour,
            dash,
        )
        for segment, colour, dash in zip(
            np.unique(run.trace.frames["segment"]),
            range(1, 8),
            (SOLID, DASHED, DOTTED) * 3,
            strict=False,
        )
    ]
    plots = [
        Figure(
            "bus-load",
            "Bus load",
            "time (s)",
            "%",
            loads,
            unit="s",
            group="bus",
            zero=True,
            note=f"share of each {LOAD_WINDOW * 1000:.0f} ms that the bus is busy",
        )
    ]
    times = response_times(run.trace)
    if times:
        curves = [
            distribution(name, values, colour=1 + i % 7, dash=i // 2 % 4)
            for i, (name, values) in enumerate(times.items())
        ]
        plots.append(
            Figure(
                "response",
                "Response times",
                "ms",
                "% of frames within x",
                curves,
                unit="ms",
                group="bus",
                linked=False,
                zero=True,
                note="from the queue to the end of the frame",
            )
        )
    ages = [
        histogram(shown.name, shown.trace.ages * 1e-6, colour=shown.colour)
        for shown in runs
        if shown.controlled and len(shown.trace.ages)
    ]
    if ages:
        plots.append(
            Figure(
                "age",
                "Age of the sample when its force begins",
                "ms",
                "% of commands",
                ages,
                unit="ms",
                group="bus",
                linked=False,
                zero=True,
            )
        )
    return plots


def _load(run: Shown, segment: int) -> tuple[Vector, Vector]:
    windows = max(int(run.trace.duration / LOAD_WINDOW), 1)
    edges: Vector = LOAD_WINDOW * np.arange(windows + 1, dtype=float)
    sums = np.zeros(windows)
    for block in blocks(run.trace.frames):
        on = block[(block["segment"] == segment) & (block["t_start"] >= 0)]
        busy = (on["t_end"] - on["t_start"]) * 1e-9
        sums += np.histogram(on["t_start"] * 1e-9, bins=edges, weights=busy)[0]
    return edges[:-1], 100 * sums / LOAD_WINDOW


def all_figures(runs: Sequence[Shown], cones: Vector) -> list[Figure]:
    """Return every plot of the page, in order; ``cones`` as of :func:`path`."""
    figures = [*motion(runs), *path(runs, cones), *control(runs), *bus(runs)]
    # those of FIRST in its order, then all others in theirs
    return sorted(figures, key=lambda each: (*FIRST, each.id).index(each.id))


def derived(vehicle: Vehicle) -> dict[str, tuple[CurveQuantity, str]]:
    """Return signals of handling that follow from the recorded ones: quantity and SI unit by name.

    All but the sideslip are of the single-track model of ISO 8855, at the middle of each axle. A
    slip angle is positive where the wheels point to the left of their way, so that its force does
    too; there is none where tables of the axles turn the wheels by more than the steering's ratio.
    """
    ahead, behind = vehicle.geometry.cg_to_front_axle, vehicle.geometry.cg_to_rear_axle
    axles, motion = vehicle.axles, ("vx", "vy", "yaw_rate")
    quantities = {
        "steering_wheel_angle": signal("steer", vehicle.steering.ratio),
        "sideslip": CurveQuantity(("vx", "vy"), lambda vx, vy: np.arctan2(vy, vx)),
        "understeer_angle": CurveQuantity(
            ("steer", "vx", "yaw_rate"),
            lambda steer, vx, rate: steer - np.arctan2((ahead + behind) * rate, vx),
        ),
    }
    if axles is None or not (axles.moves_wheels or axles.front.steering):
        quantities["slip_angle_front"] = CurveQuantity(
            ("steer", *motion),
            lambda steer, vx, vy, rate: steer - np.arctan2(vy + ahead * rate, vx),
        )
        quantities["slip_angle_rear"] = CurveQuantity(
            motion, lambda vx, vy, rate: np.arctan2(behind * rate - vy, vx)
        )
    return {name: (quantity, "rad") for name, quantity in quantities.items()}
