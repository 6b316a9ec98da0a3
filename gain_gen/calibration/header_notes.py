"""What the C header says of the design: title lines, and rows in physical units."""

from math import isfinite

from firmware.calibration import Calibration
from gain_gen.calibration.dequantise import physical_rows
from gain_gen.models.task import Design


def title(design: Design) -> list[str]:
    """Return the lines at the top of the header."""
    task = design.task
    verdict = "every check of the design holds"
    if not design.is_verified:
        failing = f"fails {', '.join(sorted(design.failures))}"
        verdict = f"NOT VERIFIED: {failing if design.failures else 'gains as printed'}"
    admitted = f"{1e3 * design.max_delay:.4g}" if isfinite(design.max_delay) else "any"
    return [
        f"canroll gains: {design.law} for {task.vehicle.name} ({task.actuator}), {task.gains}",
        f"tick {1e3 * task.tick:g} ms, designed for {1e3 * task.delay.nominal:g} ms from sample "
        f"to force, admits {admitted} ms",
        verdict,
    ]


def physical_notes(record: Calibration) -> dict[str, str]:
    """Return the coefficient rows in SI units, as comments by field."""
    return {
        name: "; ".join(" ".join(f"{value:.6g}" for value in row) for row in rows)
        for name, rows in physical_rows(record).items()
    }
