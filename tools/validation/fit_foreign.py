"""Fits of logs of a foreign car with known numbers, CommonRoad's multi-body car.

``python -m tools.validation.fit_foreign CAR COUNT [JOBS [FOLDER]]`` prints for each number in how
many logs the car's own lies within 1.96 standard deviations, and the medians of the error and of
that half-width. CAR: ``completed`` or ``published`` (:mod:`tools.validation.multi_body`), or as a
control ``plant``, ours driven alike. Outcomes in FOLDER are taken from there.

The multi-body car has tyres without relaxation and linear in load: these two numbers are held.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial
from math import exp
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification import replay, unknowns
from canroll.extensions.car.identification.fit import FitSettings
from canroll.extensions.car.identification.pieces import SAMPLE, Piece
from canroll.extensions.car.sizing.estimate import estimated
from tools.validation import fit_truth, multi_body
from tools.validation.comparison_cases import RELAXATION, SUBSTEPS, in_common
from tools.validation.fit_truth import COVERED, DURATION, NAMES, VAN, Outcome, Truth
from vehicles import Vehicle
from vehicles.fit_spread import value_of

CARS = ("completed", "published", "plant")
HELD = ("tyre.relaxation_length", "tyre.cornering_load_slope")
SETTINGS = FitSettings(imu="levelled", held=HELD)
SPEED = 22.0
"""Speed (m/s) from which a car coasts."""
IN_CG = (0.0, 0.0, 0.0)
"""Where the inertial unit is; the fits start from another place."""


def shared(vehicle: Vehicle) -> Vehicle:
    """Return ``vehicle`` restricted to what both cars have, for our plant at steps of 1 ms.

    The relaxation length is that of the comparison for a step as many times as long; a vehicle
    file needs some damping of the tyres, which the multi-body car has not.
    """
    common = in_common(vehicle)
    wheel = multi_body.light_wheel(common.tyre, multi_body.STEP)
    tyre = replace(
        common.tyre,
        relaxation_length=SUBSTEPS * RELAXATION,
        wheel_inertia=wheel,
        vertical_damping=1.0,
    )
    return replace(common, tyre=tyre)


@cache
def start() -> Vehicle:
    """Return the van where the fits start."""
    van = shared(estimated("van", VAN, name="van"))
    x, _, z = van.sensors.imu_position
    return replace(van, sensors=replace(van.sensors, imu_position=(x, 0.0, z)))


def coasted(
    car: Vehicle, steering: Piece, *, as_published: bool
) -> tuple[Piece, NDArray[np.float64]]:
    """Return the piece with the speed of the multi-body car, and its record."""
    at = multi_body.STEP * np.arange(round(len(steering.speed) * SAMPLE / multi_body.STEP))
    steer = np.interp(at, steering.time, steering.steering) / car.steering.ratio
    p = multi_body.parameters(car)
    motion = multi_body.simulate(p, SPEED, steer, as_published=as_published)
    record = np.zeros((round(at.size * multi_body.STEP / replay.ROW), replay.N_COLUMNS))
    rows = replay.ROW * np.arange(len(record))
    for column, signal in (
        (replay.YAW, motion.yaw_rate),
        (replay.AY, motion.body_acceleration),
        (replay.ROLL_RATE, motion.roll_rate),
        (replay.ROLL, motion.roll),
        (replay.SIDESLIP, motion.sideslip),
        # where a wheel has lifted, its tyre would pull at the road
        (replay.ROLLOVER, (motion.loads < 0.0).any(axis=1)),
    ):
        record[:, column] = np.interp(rows, at + multi_body.STEP, signal)
    speed = np.interp(steering.time, at + multi_body.STEP, motion.speed)
    return replace(steering, speed=speed), record


def truth(car: str, seed: int, duration: float = DURATION) -> Truth:
    """Draw the numbers of a car of :data:`CARS` and its log; our plant has the other's speed."""
    generator = np.random.default_rng(seed)
    sought = unknowns.unknowns(start(), NAMES, held=HELD)
    time = np.asarray(SAMPLE * np.arange(round(duration / SAMPLE)), float)
    steering = fit_truth.steering(generator, time)
    nothing = np.zeros((time.size, len(NAMES)))
    piece = Piece(0.0, steering, np.zeros(time.size), NAMES, nothing)
    for numbers, drawn in fit_truth.cars(generator, start(), sought):
        own = shared(replace(drawn, sensors=replace(drawn.sensors, imu_position=IN_CG)))
        piece, record = coasted(own, piece, as_published=car == "published")
        if car == "plant":
            record = replay.motion(own, piece, 0.0)
        if fit_truth.measurable(record):
            numbers |= {u.key: value_of(own, u.key) for u in sought if not u.of_log}
            columns = fit_truth.sensed(generator, piece, record, numbers, frame=SETTINGS.imu)
            return Truth(start(), numbers, columns)
    raise AssertionError  # the cars never end


def outcome(car: str, seed: int) -> Outcome:
    """Fit one log and compare with its car."""
    return fit_truth.compared(truth(car, seed), SETTINGS)


def table(outcomes: list[Outcome]) -> Iterator[str]:
    """Lines of the table, of the numbers of the vehicle."""
    yield "| number | car's own within ± 95 % | error, median | ± 95 %, median | unit |"
    yield "| --- | ---: | ---: | ---: | --- |"
    sought = {u.key: u for u in unknowns.unknowns(start(), NAMES, held=HELD) if not u.of_log}
    within, total = 0, 0
    for rows in zip(*(one.rows for one in outcomes), strict=True):
        if (u := sought.get(rows[0].key)) is None:
            continue
        good = sum(abs(row.error) < COVERED * row.deviation for row in rows)
        within, total = within + good, total + len(rows)
        error = float(np.median([row.error for row in rows])) * u.deviation
        half = COVERED * float(np.median([row.deviation for row in rows])) * u.deviation
        if u.positive:
            error, half = (100.0 * (exp(x / u.mean) - 1.0) for x in (error, half))
        unit = "%" if u.positive else u.unit
        yield f"| {u.label} | {good} of {len(rows)} | {error:+.2g} | {half:.2g} | {unit} |"
    yield f"| all | {within} of {total} | | | |"


def main(arguments: list[str]) -> int:
    """Run the command; return the exit code."""
    match arguments:
        case [car, count, *more] if (
            car in CARS and len(more) < 3 and all(map(str.isdecimal, (count, *more[:1])))
        ):
            folder = Path(more[1], car) if more[1:] else None
            jobs = int(more[0]) if more else 1
            outcomes = fit_truth.batch(int(count), jobs, folder, partial(outcome, car))
            print("\n".join(table(outcomes)))
            return 0
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
