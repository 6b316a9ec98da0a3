"""Timing figures of a real-time run: quantiles, histograms, sample-to-force latency, losses."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.firmware.event_trigger import command_slot
from canroll.firmware.state import RX_IMU
from canroll.hil.hardware import bus_record
from canroll.hil.tick_trace import TickTrace
from canroll.hil.timing_rows import QUANTILES
from canroll.plant_sim.world.received import received_by_ecu

Times = NDArray[np.int64]


def quantiles(values_ns: Times) -> dict[str, float] | None:
    """Return the figures of ``values_ns`` in µs by name (:data:`QUANTILES`), None without values.

    A quantile is a measured value: the smallest with at least that share at or below it.
    """
    if not len(values_ns):
        return None
    values = np.quantile(values_ns, list(QUANTILES.values()), method="inverted_cdf")
    return {name: float(value) / 1e3 for name, value in zip(QUANTILES, values, strict=True)}


def histogram(values_ns: Times) -> dict[str, Any]:
    """Return jitterdebugger's record of one core: counts by whole µs, min, max, avg."""
    values = values_ns // 1000
    bins, counts = np.unique(values, return_counts=True)
    return {
        "histogram": {str(int(b)): int(c) for b, c in zip(bins, counts, strict=True)},
        "count": len(values),
        "min": int(bins[0]) if len(bins) else 0,
        "max": int(bins[-1]) if len(bins) else 0,
        "avg": float(values.mean()) if len(values) else 0.0,
    }


def jitterdebugger(cores: Mapping[int, Times]) -> dict[str, Any]:
    """Return the wake-up latencies of each core in jitterdebugger's ``results.json`` format."""
    name = os.uname()
    return {
        "version": 3,
        "sysinfo": {
            "sysname": name.sysname,
            "nodename": name.nodename,
            "release": name.release,
            "version": name.version,
            "machine": name.machine,
            "cpus_online": os.cpu_count() or 1,
        },
        "cpu": {str(core): histogram(values) for core, values in sorted(cores.items())},
    }


def start_jitter(trace: TickTrace) -> Times:
    """Return the lateness of each tick's start, ns."""
    jitter: Times = trace.ticks["start_ns"] - trace.ticks["deadline_ns"]
    return jitter


def durations(trace: TickTrace) -> Times:
    """Return the duration of each tick, including reading and sending of frames, ns."""
    took: Times = trace.ticks["end_ns"] - trace.ticks["start_ns"]
    return took


def misses(trace: TickTrace) -> int:
    """Return the number of ticks that were skipped."""
    return int(np.sum(trace.ticks["elapsed"].astype(np.int64) - 1))


def latencies(
    trace: TickTrace,
    commands: NDArray[np.void],
    frames: NDArray[np.void],
    *,
    start_ns: int,
    sensor_latency_ns: int,
    firmware: BusFirmware | None = None,
) -> Times:
    """Return the time from sample to force of each applied command, ns.

    The tick that sent the command identifies the Imu frame that the firmware read last, and the
    plant's log the instant of its sample: a frame that arrived while the tick ran is not mistaken
    for the one used.

    Args:
        trace: trace of the ECU.
        commands: applied commands of the plant (``canroll.plant_sim.world.recording.COMMAND``).
        frames: the plant's bus log.
        start_ns: monotonic instant of plant time 0.
        sensor_latency_ns: from the sample to the Imu frame in its queue.
        firmware: firmware for the bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    sent, read = _commands_and_samples(trace, firmware)
    imu = firmware.bus.received[RX_IMU]
    sampled: dict[bytes, list[tuple[int, int]]] = {}
    for entry in received_by_ecu(frames, imu.ident):
        instants = (int(entry["t_received"]), int(entry["t_origin"]) - sensor_latency_ns)
        sampled.setdefault(entry["payload"][: imu.length].tobytes(), []).append(instants)
    ages = []
    for command in commands:
        # counters come round: of the ticks that sent this one, the nearest in time is meant
        candidates = np.flatnonzero(sent["counter"] == command["counter"])
        if not len(candidates):
            continue
        t_submitted = int(command["t_submitted"]) + start_ns
        last = int(candidates[np.argmin(np.abs(sent["t_ns"][candidates] - t_submitted))])
        if not read[last]:
            continue
        # a plant that stood still has read commands whose ticks are later than its own time
        before = min(int(sent["t_ns"][last]) - start_ns, int(command["t_submitted"]))
        known = [sample for received, sample in sampled.get(read[last], []) if received <= before]
        if known:
            ages.append(int(command["t_applied"]) - known[-1])
    return np.array(ages, dtype=np.int64)


def bus_figures(
    entries: NDArray[np.void], about: Mapping[str, Any] | None
) -> dict[str, Any] | None:
    """Return one program's figures of the real bus; None for a simulated bus.

    ``wait_us`` is the time frames waited at the interface before they were read.
    """
    if about is None:
        return None
    waits, missing = bus_record.waits_ns(entries, about)
    figures = bus_record.summary(entries, about)
    return {**figures, "wait_us": quantiles(waits), "wait_missing": missing}


def _commands_and_samples(
    trace: TickTrace, firmware: BusFirmware
) -> tuple[NDArray[np.void], list[bytes]]:
    """Return each command's start of tick and counter, and the Imu payload it was computed from."""
    command = firmware.bus.transmitted[command_slot(trace.calibration)]
    imu = firmware.bus.received[RX_IMU]
    rows, read, newest, first = [], [], b"", 0
    frames = np.asarray(trace.frames)
    for tick in np.asarray(trace.ticks):
        for frame in frames[first : first + int(tick["frames"])]:
            if frame["ident"] == imu.ident and not frame["sent"]:
                newest = frame["payload"][: imu.length].tobytes()
            elif frame["ident"] == command.ident and frame["sent"]:
                rows.append((int(tick["start_ns"]), command.count(frame["payload"])))
                read.append(newest)
        first += int(tick["frames"])
    return np.array(rows, dtype=[("t_ns", "i8"), ("counter", "i8")]), read
