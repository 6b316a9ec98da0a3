"""What the timing figures of a real-time run are called; those of its bus as sentences."""

from collections.abc import Mapping
from typing import Any

QUANTILES = {"min": 0.0, "p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
ROWS = {
    "start_jitter_us": "tick start after its deadline",
    "tick_us": "tick duration",
    "latency_us": "sample to force",
    "plant_jitter_us": "plant step after its deadline",
    "plant_step_us": "plant step duration",
}
"""What is timed of a run in real time, and its name."""


def bus_lines(timing: Mapping[str, Any]) -> list[str]:
    """Return each program's figures of the real bus, one sentence each."""
    names = {"ecu": "bus at the ECU", "plant": "bus at the plant"}
    seen = timing.get("bus", {})
    return [_bus_line(name, seen[side]) for side, name in names.items() if seen.get(side)]


def _bus_line(side: str, figures: Mapping[str, Any]) -> str:
    """Return :func:`canroll.hil.timing.bus_figures` as a sentence."""
    load = f"load unknown {figures['load_missing']}"
    if figures["load"] is not None:
        load = f"load {100 * figures['load']:.1f} % of {figures['bitrate'] / 1000:g} kbit/s"
    parts = [f"{figures['frames']} frames", load, f"{figures['error_frames']} error frames"]
    if figures["errors"]:
        parts[-1] += f" ({', '.join(f'{name} {n}' for name, n in figures['errors'].items())})"
    if figures["wait_us"] is None:
        parts.append(f"no wait at the interface: {figures['wait_missing']}")
    else:
        wait = figures["wait_us"]
        parts.append(
            f"waited {wait['p50']:.0f} µs at the interface, at most {wait['max']:.0f} µs, "
            f"by {figures['clock']}"
        )
    if figures["full"]:
        parts.append("the record was full before the end")
    return f"{side}, {figures['interface']}: {'; '.join(parts)}"
