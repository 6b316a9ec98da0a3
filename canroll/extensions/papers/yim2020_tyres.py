"""Yim 2020: the printed gains on a linear car with tyres and unsprung masses."""

import numpy as np

from canroll.extensions.papers.paper_table import PaperSection, Value, printed
from canroll.gain_gen.analysis.held_plant import HeldPlant, held
from canroll.gain_gen.laws.state_feedback import PRINTED
from canroll.gain_gen.models.full_car import ROLL, ROLL_RATE
from canroll.gain_gen.models.roll import Matrix
from canroll.vehicles import Vehicle
from canroll.vehicles.full_car import INPUTS, STATES, from_vehicle, state_matrices
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

DELAYS_MS = (0.0, 5.0, 10.0, 20.0)


def on_tyres(paper: str, vehicle: Vehicle, speed: float) -> PaperSection:
    """Return whether the printed gains are stable on a car with tyres at ``speed``, m/s."""
    stiffness = suspension_roll_stiffness(vehicle)
    a, b = state_matrices(from_vehicle(vehicle, suspension_stiffness=stiffness), speed)
    lag = printed(paper)["aarb"]["time_constant_s"]
    body = [STATES.index(name) for name in STATES if not name.endswith(("_front", "_rear"))]
    moments = [INPUTS.index(f"moment_{axle}") for axle in ("front", "rear")]
    count = len(body)
    with_lag = np.zeros((count + 1, count + 1))
    with_lag[:count, :count] = a[np.ix_(body, body)]
    # half of the moment on each axle, as the paper has it
    with_lag[:count, count] = b[np.ix_(body, moments)].mean(axis=1)
    with_lag[count, count] = -1 / lag
    command = np.zeros((count + 1, 1))
    command[count] = 1 / lag
    rows: list[dict[str, Value]] = []
    for law, (angle, rate) in PRINTED.items():
        gain = np.zeros((1, count + 1))
        gain[0, [body.index(ROLL), body.index(ROLL_RATE)]] = angle, rate
        row: dict[str, Value] = {"law": law}
        for delay in DELAYS_MS:
            plant = held(
                with_lag, command, tick=printed(paper)["sample_time_s"], delay=1e-3 * delay
            )
            row[f"radius_{delay:g}_ms"] = spectral_radius(plant, gain)
        rows.append(row)
    return PaperSection(
        "on_tyres",
        "Largest |z| of the printed gains on the linear car with tyres, true states",
        {"law": "law", **{f"radius_{delay:g}_ms": f"{delay:g} ms" for delay in DELAYS_MS}},
        rows,
        "Calibrated car at 80 km/h, tick 10 ms, bars with their lag, plus a constant delay; below "
        "1 the loop is stable. With true states H∞ and SMC rest over our bus too, on the same "
        "tyres; with the roll rate alone and the observer both oscillate.",
    )


def spectral_radius(plant: HeldPlant, gain: Matrix) -> float:
    """Return the largest |z| of u = −K x around a plant with delayed, held commands."""
    count, steps = len(plant.phi), plant.steps
    closed = np.zeros((count + steps, count + steps))
    closed[:count, :count] = plant.phi
    # newest command first: what acts is number steps − 1 and number steps of the line
    commands = np.zeros((steps + 1, count + steps))
    commands[0, :count] = -gain
    commands[1:, count:] = np.eye(steps)
    if steps:
        closed[:count] += plant.fresh @ commands[[steps - 1]] + plant.stale @ commands[[steps]]
        closed[count:] = commands[:-1]
    else:
        closed[:count] += plant.fresh @ commands[[0]]
    return float(np.max(np.abs(np.linalg.eigvals(closed))))
