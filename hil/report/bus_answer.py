"""Output of ``canroll bus``: table, lines and JSON object of a traffic set's response times."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from canroll.errors import VerdictError
from plant_sim.can_bus.analysis import ResponseBound, worst_case_utilisation
from plant_sim.can_bus.delay_bounds import DelayBounds
from plant_sim.can_bus.simulation import SimulatedResponse, Simulation
from plant_sim.can_bus.traffic.files import Traffic
from plant_sim.can_bus.traffic.log_playback import Recording
from plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH

_MS = 1e-6


@dataclass(frozen=True, slots=True)
class Delay:
    """Bounds of the total delay, and the simulated extreme ages, ns.

    Without bounds ``reason`` gives the cause; ``failed``: the set has none, not only this analysis.
    """

    bounds: DelayBounds | None
    reason: str
    failed: bool
    least: float
    greatest: float


@dataclass(frozen=True, slots=True)
class Answer:
    """Printed results of the set in file ``name``, simulated for ``duration`` s.

    ``sensor``, ``command``: the messages of the delay, at a tick of ``tick_ms``; ``log``: the file
    of the recording beside the set.
    """

    name: str
    duration: float
    sensor: str
    command: str
    tick_ms: float
    log: str | None
    traffic: Traffic
    bounds: list[ResponseBound]
    simulation: Simulation | None
    delay: Delay | None
    recording: Recording | None


def is_late(bound: ResponseBound) -> bool:
    """Return whether a deadline of the set is missed; exceeding the period alone does not count."""
    limit = bound.message.deadline_ns
    return bool(limit) and bound.bound_ns is not None and bound.bound_ns > limit


def check_simulation(answer: Answer) -> None:
    """Reject a bound that the simulation exceeds.

    Raises:
        VerdictError: it does.
    """
    for bound in answer.bounds:
        _, _, seen = _extremes(answer.simulation, bound.message.name)
        if bound.bound_ns is not None and seen > bound.bound_ns:
            raise VerdictError(
                f"{bound.message.name}: simulated response {seen * _MS:.3f} ms above its bound"
                f" {bound.bound_ns * _MS:.3f} ms"
            )
    check_ages(answer.delay)


def check_ages(delay: Delay | None) -> None:
    """Reject a bound of the age that the simulation exceeds.

    Raises:
        VerdictError: it does.
    """
    if delay is None or delay.bounds is None:
        return
    # simulated times are whole ns, the bound is a float of seconds: equal ones may differ there
    most, limit = delay.greatest, delay.bounds.age_max
    if most > round(limit * 1e9):
        raise VerdictError(
            f"simulated age {most * _MS:.3f} ms above its bound {limit * 1e3:.3f} ms"
        )


def milliseconds(value: float | None) -> float | None:
    """Return nanoseconds in milliseconds, None where there is no value."""
    return None if value is None or math.isnan(value) else round(value * _MS, 6)


def _extremes(simulation: Simulation | None, name: str) -> tuple[float, float, float]:
    """Least, mean and greatest simulated response, ns; NaN if there is none."""
    if simulation is None:
        return math.nan, math.nan, math.nan
    return extremes(simulation.responses[name].responses)


def extremes(times: NDArray[np.int64]) -> tuple[float, float, float]:
    """Return least, mean and greatest of simulated times; not a number where there are none."""
    if not len(times):
        return math.nan, math.nan, math.nan
    return float(times.min()), float(times.mean()), float(times.max())


def as_json(answer: Answer) -> dict[str, Any]:
    """Return the object that ``--json`` prints."""
    traffic, simulation, recording = answer.traffic, answer.simulation, answer.recording
    messages = {}
    for bound in answer.bounds:
        name = bound.message.name
        least, mean, greatest = _extremes(simulation, name)
        messages[name] = {
            "response_bound_ms": milliseconds(bound.bound_ns),
            "response_min_ms": milliseconds(least),
            "response_mean_ms": milliseconds(mean),
            "response_max_ms": milliseconds(greatest),
        }
    result: dict[str, Any] = {
        "utilisation": _utilisation(traffic),
        "messages": messages,
        "recording": None,
        "warnings": list(traffic.warnings),
    }
    if simulation:
        result["simulated_load"] = simulation.load
    if recording:
        result["recording"] = {
            "frames": len(recording.frames.t_ns),
            "duration_s": recording.duration_s,
            "channel": recording.channel,
            "error_frames": recording.errors,
            "remarks": list(recording.remarks),
        }
    if answer.delay:
        result["delay"] = delay_json(answer.delay)
    return result


def delay_json(delay: Delay) -> dict[str, float | None]:
    """Return the object of the delay."""
    total = delay.bounds
    return {
        "tau_min_ms": None if total is None else total.tau_min * 1e3,
        "tau_max_ms": None if total is None else total.tau_max * 1e3,
        "age_bound_ms": None if total is None else total.age_max * 1e3,
        "age_min_ms": milliseconds(delay.least),
        "age_max_ms": milliseconds(delay.greatest),
    }


def _utilisation(traffic: Traffic) -> float:
    return worst_case_utilisation(
        traffic.messages, bitrate=traffic.bitrate, data_bitrate=traffic.data_bitrate
    )


def show(answer: Answer) -> None:
    """Print the table and the lines below it."""
    console = Console()
    console.print(_table(answer))
    traffic, simulation, bounds = answer.traffic, answer.simulation, answer.bounds
    for reason in dict.fromkeys(b.reason for b in bounds if b.bound_ns is None):
        names = ", ".join(b.message.name for b in bounds if b.reason == reason)
        console.print(f"without a bound, {reason}: {names}")
    late = [b for b in bounds if is_late(b)]
    if late:
        told = (
            f"{b.message.name} ({b.bound_ns * _MS:.3f} of {b.message.deadline_ns * _MS:g} ms)"
            for b in late
            if b.bound_ns is not None
        )
        console.print(f"deadline missed: {', '.join(told)}", highlight=False)
    line = f"load with the longest frames {_utilisation(traffic):.1%}"
    if simulation:
        line += f", simulated {simulation.load:.1%} ({simulation.frames} frames)"
    console.print(line)
    if traffic.left_out:
        console.print(
            f"without a cycle time (GenMsgCycleTime), left out: {', '.join(traffic.left_out)}"
            " (--period MS)",
            markup=False,
        )
    if not traffic.data_bitrate and any(m.flags & BIT_RATE_SWITCH for m in traffic.messages):
        console.print(
            "no data bit rate in the set: the data of FD frames at the nominal one"
            " (--data-bitrate B)"
        )
    recording, duration = answer.recording, answer.duration
    if recording:
        for remark in recording.remarks:
            console.print(f"{answer.log}: {remark}", highlight=False)
        if recording.errors:
            console.print(f"error frames in {answer.log}, not replayed: {recording.errors}")
    if recording and recording.duration_s < duration:
        console.print(f"{answer.log} ends after {recording.duration_s:g} s of {duration:g} s")
    if answer.delay:
        console.print(delay_line(answer.delay, answer.sensor, answer.command, answer.tick_ms))


def _table(answer: Answer) -> Table:
    traffic = answer.traffic
    rate = f"{traffic.bitrate / 1000:g}"
    if traffic.data_bitrate:
        rate += f" and {traffic.data_bitrate / 1000:g}"
    title = f"{answer.name} at {rate} kbit/s: response times, ms"
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("message", "id", "period", "bound", "min", "mean", "99 %", "max"):
        table.add_column(heading, justify="left" if heading == "message" else "right")
    for bound in sorted(answer.bounds, key=lambda b: b.message.ident):
        message = bound.message
        limit = "none" if bound.bound_ns is None else f"{bound.bound_ns * _MS:.3f}"
        seen = answer.simulation and answer.simulation.responses[message.name]
        cells = cells_of(seen or None)
        period = f"{message.period_ns * _MS:g}"
        table.add_row(message.name, f"{message.ident:X}", period, limit, *cells)
    return table


def cells_of(simulated: SimulatedResponse | None) -> list[str]:
    """Return least, mean, 99 % and greatest of simulated times in ms, dashes without any."""
    if simulated is None or not len(simulated.responses):
        return ["–"] * 4
    least, mean, greatest = extremes(simulated.responses)
    return [f"{t * _MS:.3f}" for t in (least, mean, simulated.quantile(0.99), greatest)]


def delay_line(delay: Delay, sensor: str, command: str, tick_ms: float) -> str:
    """Return the line on the total delay from ``sensor`` to ``command``."""
    line = f"{sensor} to {command} at a tick of {tick_ms:g} ms: "
    if delay.bounds is None:
        line += f"no bound of the delay, {delay.reason}; sample-to-force age"
    else:
        total = delay.bounds
        line += (
            f"total delay {total.tau_min * 1e3:.2f} to {total.tau_max * 1e3:.2f} ms,"
            f" sample-to-force age at most {total.age_max * 1e3:.2f} ms"
        )
    if math.isnan(delay.least):
        return line if delay.bounds else f"{line} not simulated"
    separator = "," if delay.bounds else ""
    return f"{line}{separator} simulated {delay.least * _MS:.2f} to {delay.greatest * _MS:.2f}"
