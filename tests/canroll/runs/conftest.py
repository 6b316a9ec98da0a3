"""A made-up run with figures that can be told by hand."""

import numpy as np
import pytest

from canroll.plant_sim.bodies.ports import WHEELS
from canroll.plant_sim.can_bus.kernel.layout import log_dtype
from canroll.runs.trace import TICK, Trace

SECONDS = 8.0


def trace(*, amplitude=0.05, moment=800.0, frequency=0.5, commands=True) -> Trace:
    time = np.arange(0.0, SECONDS + 5e-4, 1e-3)
    wave = np.sin(2 * np.pi * frequency * time)
    rate = 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * time)
    transfer = 3000.0 * wave
    signals = {
        "time": time,
        "roll": amplitude * wave,
        "roll_rate": amplitude * rate,
        "ay": 4.0 * wave,
        "moment_front": -0.6 * moment * wave,
        "moment_rear": -0.4 * moment * wave,
        "steer": 0.05 * wave,
        "x": 20.0 * time,
        "y": 1.75 - 1.75 * np.cos(2 * np.pi * frequency * time / 4),
        "yaw": 0.05 * wave,
        "path_error": 0.1 * wave,
        "bank": np.zeros_like(time),
        "rollover": np.zeros_like(time),
    }
    for wheel, sign in zip(WHEELS, (-1, 1, -1, 1), strict=True):
        signals[f"wheel_load_{wheel}"] = 6000.0 + sign * transfer / 2
        signals[f"corner_force_{wheel}"] = sign * moment * wave / 4
    ticks = np.zeros(round(SECONDS / 0.01), TICK)
    ticks["t"] = np.arange(1, len(ticks) + 1) * 0.01
    ticks["mode"] = np.where(ticks["t"] < 0.5, 0, 1)
    ticks["roll"] = np.interp(ticks["t"], time, signals["roll"])
    ticks["moment"] = np.interp(ticks["t"], time, -moment * wave)
    if commands:
        ticks["triggered"][50::5] = 1
        ticks["triggered"][52::25] = 2
    return Trace(
        signals=signals,
        frames=frames(),
        ages=np.linspace(8e6, 24e6, 500).astype(np.int64),
        ticks=ticks,
        duration=SECONDS,
    )


def frames() -> np.ndarray:
    """One Imu frame of 240 µs each 10 ms, one ActuatorState right behind it."""
    count = round(SECONDS / 0.01)
    log = np.zeros(2 * count, log_dtype())
    queued = np.arange(count) * 10_000_000
    for place, ident, delay in ((0, 0xA0, 0), (1, 0xD0, 240_000)):
        of = log[place::2]
        of["ident"] = ident
        of["t_origin"] = of["t_queued"] = queued
        of["t_start"] = queued + delay
        of["t_received"] = queued + delay + 230_000
        of["t_end"] = queued + delay + 240_000
        of["length"] = 8
        of["payload"][:, :8] = np.arange(8)
    return log


@pytest.fixture(scope="session")
def make_trace():
    return trace
