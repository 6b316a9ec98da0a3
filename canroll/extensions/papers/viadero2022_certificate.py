"""Viadero 2022: what y is, roll rate or roll angle, and where its trigger sits.

The paper prints y = φ, and a gain that fits the roll rate. Both readings are put through the
inequality with the printed P, through exact analysis, and through the lane change.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from math import sqrt

import numpy as np

from canroll import vehicles
from canroll.extensions.papers.paper_table import PaperSection, Value, finite, printed
from canroll.extensions.papers.roll_loop import RollLoop, motion
from canroll.gain_gen.analysis.certificates import (
    certified_level,
    event_block,
    event_small_gain,
    si_plant,
)
from canroll.gain_gen.analysis.delay_system import h_infinity, largest_delay
from canroll.gain_gen.laws.hinf_event import PRINTED_EVENT_GAIN
from canroll.gain_gen.laws.lmi import Clock, fixed_lyapunov_certificate
from canroll.gain_gen.models.roll import PERFORMANCE, ROLL_RATE, disturbance_input, moment_input
from canroll.gain_gen.models.task import EPSILON_SQUARED
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.can_bus.bounds.delay_bounds import message_paths
from canroll.runs.result import Result
from canroll.typing import Vector

PAPER = "viadero2022"
SAMPLING = 0.020
NETWORK = 0.020
"""Sampling period and longest network delay as printed, s."""
READINGS = {"roll rate": ROLL_RATE, "roll angle": np.array([[1.0, 0.0]])}
BUS = "500k"
WATCHED = ("Imu", "RollControlStatus")
"""Messages below the command in priority: those that its frames may hold up."""
MS = 1e3


def readings(lateral: Vector, scale: float) -> PaperSection:
    """Return certificates, exact figures and lane change for both readings of y.

    Args:
        lateral: of the lane change at 100 km/h without control, m/s², each millisecond.
        scale: fitted factor on it.
    """
    model = vehicles.load("van_2022").design
    tables = printed(PAPER)
    without = motion(RollLoop(model), scale * lateral)
    rows: list[dict[str, Value]] = []
    for name, output in READINGS.items():
        plant = si_plant(model, output)
        row: dict[str, Value] = {"reading": name}
        delayed = PRINTED_EVENT_GAIN * moment_input(model) @ output
        for delay in (SAMPLING, SAMPLING + NETWORK):
            suffix = f"{1e3 * delay:.0f}_ms"
            block = partial(
                event_block,
                plant,
                gain=PRINTED_EVENT_GAIN,
                delay=delay,
                epsilon_squared=EPSILON_SQUARED,
            )
            point = fixed_lyapunov_certificate(
                block, np.array(tables["lyapunov_p"]), PRINTED_EVENT_GAIN, Clock()
            )
            exact = h_infinity(plant.a, delayed, disturbance_input(model), PERFORMANCE, delay=delay)
            small = sqrt(EPSILON_SQUARED) * event_small_gain(
                plant, gain=PRINTED_EVENT_GAIN, delay=delay
            )
            as_it_is = certified_level(
                plant,
                gain=PRINTED_EVENT_GAIN,
                p=np.array(tables["lyapunov_p"]),
                r=tables["lyapunov_r"],
                s=tables["lyapunov_s"],
                delay=delay,
                epsilon_squared=EPSILON_SQUARED,
            )
            row |= {
                f"printed_multipliers_gamma_squared_{suffix}": finite(as_it_is),
                f"certified_gamma_squared_{suffix}": None if point is None else point.gamma_squared,
                f"exact_gamma_squared_{suffix}": finite(exact**2),
                f"small_gain_{suffix}": finite(small),
            }
        most = largest_delay(plant.a, plant.b, PRINTED_EVENT_GAIN * output)
        row["largest_delay_ms"] = finite(MS * most)
        loop = RollLoop(
            model,
            feedback=PRINTED_EVENT_GAIN * output,
            sampling=SAMPLING,
            delay=NETWORK,
            epsilon_squared=EPSILON_SQUARED,
        )
        controlled = motion(loop, scale * lateral)
        for quantity in ("roll_rms", "roll_max", "roll_rate_rms", "roll_rate_max"):
            change = controlled.figure(quantity) / without.figure(quantity) - 1
            row[f"{quantity}_change_percent"] = finite(100 * change)
        row["transmission_rate_percent"] = finite(100 * controlled.figure("transmission_rate"))
        rows.append(row)
    table = tables["double_lane_change_100"]
    as_printed: dict[str, Value] = dict.fromkeys(rows[0])
    as_printed |= {"reading": "printed", "certified_gamma_squared_20_ms": tables["gamma_squared"]}
    for quantity in ("roll_rms", "roll_max", "roll_rate_rms"):
        change = table["active"][quantity] / table["passive"][quantity] - 1
        as_printed[f"{quantity}_change_percent"] = 100 * change
    as_printed["transmission_rate_percent"] = 100 * table["active"]["transmission_rate"]
    return PaperSection(
        "readings_of_y",
        "Both interpretations of y, with the printed gain and P",
        {
            "reading": "y",
            "printed_multipliers_gamma_squared_20_ms": "γ² by the printed P, R, S, 20 ms",
            "printed_multipliers_gamma_squared_40_ms": "γ² by the printed P, R, S, 40 ms",
            "certified_gamma_squared_20_ms": "γ² by the printed P, best R, S, 20 ms",
            "certified_gamma_squared_40_ms": "γ² by the printed P, best R, S, 40 ms",
            "exact_gamma_squared_20_ms": "exact γ², no trigger, 20 ms",
            "exact_gamma_squared_40_ms": "exact γ², no trigger, 40 ms",
            "small_gain_20_ms": "trigger's small gain, 20 ms (< 1)",
            "small_gain_40_ms": "trigger's small gain, 40 ms (< 1)",
            "largest_delay_ms": "largest delay (ms)",
            "roll_rms_change_percent": "roll RMS (%)",
            "roll_max_change_percent": "roll max (%)",
            "roll_rate_rms_change_percent": "rate RMS (%)",
            "roll_rate_max_change_percent": "rate max (%)",
            "transmission_rate_percent": "measurements sent (%)",
        },
        [*rows, as_printed],
        "None: no level is certified, no delay is admissible, or no usable value is printed. "
        f"{_multipliers(rows)} The paper does not print the inequality; the bounded-real "
        "inequality on [x, q, e, w] of the theory notes is used. The lane change is the 1-DOF "
        "model under the lateral acceleration of the passive run at 100 km/h, sampled every 20 "
        "ms with the printed trigger at the sensor and a delay of 20 ms.",
        upright=True,
    )


def _multipliers(rows: Sequence[Mapping[str, Value]]) -> str:
    """Say whether P, R and S certify anything as they are printed."""
    tables = printed(PAPER)
    holds = any(
        row[f"printed_multipliers_gamma_squared_{delay}"] is not None
        for row in rows
        for delay in ("20_ms", "40_ms")
    )
    return f"R = {tables['lyapunov_r']:.2g} and S = {tables['lyapunov_s']:.3g} as printed " + (
        "certify a level."
        if holds
        else "certify no level with any Ω, for either interpretation of y."
    )


def relative_rule(commands: Vector, *, floor: float = 0.0) -> int:
    """Return how many of the sampled K y the rule (9) sends: e² > ε² ũ² + floor²."""
    sent, last = 0, 0.0
    for command in commands:
        if (command - last) ** 2 > EPSILON_SQUARED * last**2 + floor**2:
            sent, last = sent + 1, float(command)
    return sent


def places(result: Result) -> PaperSection:
    """Return how often the rule fires at the sensor, as the paper has it, and at our ECU."""
    assert result.controlled is not None
    trace = result.controlled
    ticks = trace.ticks[trace.ticks["mode"] > 0]
    rate = np.interp(ticks["t"], trace.signals["time"], trace.signals["roll_rate"])
    count = len(ticks)
    quiet = relative_rule(PRINTED_EVENT_GAIN * rate)
    noisy = relative_rule(ticks["moment"])
    trigger, delay = result.trigger, result.delay
    own = trigger.sent - trigger.heartbeats
    loops = (
        ("at the sensor", "(9), roll rate without noise", 1.0, quiet, quiet),
        ("at the sensor", "(9), roll rate as measured", 1.0, noisy, noisy),
        ("at the ECU", "with floor, against the echo", 2.0, count, own),
        ("at the ECU", "the same with heartbeats", 2.0, count, trigger.sent),
    )
    rows: list[dict[str, Value]] = [
        {
            "place": place,
            "rule": rule,
            "hops": hops,
            "measurements_percent": 100 * measurements / count,
            "commands_percent": 100 * commands / count,
        }
        for place, rule, hops, measurements, commands in loops
    ]
    return PaperSection(
        "place_of_trigger",
        "Location of the trigger, lane change at 100 km/h",
        {
            "place": "place",
            "rule": "rule",
            "hops": "hops in the delay",
            "measurements_percent": "measurements sent (%)",
            "commands_percent": "commands sent (%)",
        },
        rows,
        "The paper's trigger compares measurements before the network: one hop of delay and "
        "fewer measurements, but no knowledge of the state of the actuator. Ours compares the "
        "command with the one acknowledged by the actuator: two hops, here at most "
        f"{MS * delay.most:.0f} ms from motion to force, and a lost frame is sent again. Rule (9) "
        "is replayed on the roll rate of the same run; being relative, it keeps firing while the "
        "motion decays, with or without noise; the floor prevents that.",
    )


def load_and_bound(runs: dict[str, Result]) -> PaperSection:
    """Return that triggering lowers the mean load, and leaves the worst-case bounds.

    Args:
        runs: the lane change over :data:`BUS` by trigger rule, "every" and "event".
    """
    rows: list[dict[str, Value]] = []
    for name, result in runs.items():
        assert result.controlled is not None
        command = result.settings.command
        # the rule may fire in every tick: the tick is the least distance that a bound may assume
        paths = message_paths(
            load_profile(BUS), command=command, command_period_ms=MS * result.settings.tick
        )
        row: dict[str, Value] = {
            "trigger": name,
            "mean_load_percent": 100 * result.can.load,
            "commands_per_second": result.trigger.sent / result.controlled.duration,
            "least_distance_ms": MS * result.settings.tick,
        }
        for message in WATCHED:
            row[f"{message}_bound_ms"] = MS * paths[message].greatest
            row[f"{message}_seen_ms"] = result.can.response_ms[message].max
        rows.append(row)
    labels = {
        "trigger": "commands",
        "mean_load_percent": "mean load (%)",
        "commands_per_second": "commands (1/s)",
        "least_distance_ms": "least distance (ms)",
    }
    for message in WATCHED:
        labels |= {
            f"{message}_bound_ms": f"{message}: worst-case response (ms)",
            f"{message}_seen_ms": f"{message}: longest response seen (ms)",
        }
    return PaperSection(
        "load_and_bound",
        f"Mean load and worst case, bus {BUS}",
        labels,
        rows,
        "Triggering reduces the average number of frames. Since the rule may still fire in every "
        "tick, the minimum distance of two commands remains the tick, and every worst-case "
        "response time (Davis et al. 2007) remains the same.",
    )
