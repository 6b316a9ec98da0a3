"""The page of a recorded drive: what came in, modes and codes, estimates, would-be commands."""

from collections.abc import Sequence

import numpy as np

from canroll.reaction.fault_codes import MODES
from canroll.report.curves import dash
from canroll.report.figure import Figure, Series
from canroll.report.page import Page, PageTable, PageVerdict, render
from canroll.report.tables import number
from canroll.studies.recorded_drive import RecordedDrive
from canroll.typing import Vector


def drive_page(drive: RecordedDrive, source: str, parameters: Sequence[tuple[str, str]]) -> str:
    """Return the page as HTML; ``source`` names the log."""
    return render(
        Page(
            title="Recorded drive",
            subtitle=f"{source}, {drive.seconds:.1f} s, open loop",
            verdict=PageVerdict(None, "Open loop", drive.verdict),
            warnings=drive.warnings,
            tables=[reception_table(drive), *_events(drive)],
            figures=_figures(drive),
            playback=None,
            parameters=parameters,
            provenance=(),
            result=drive.to_json(),
        )
    )


def reception_table(drive: RecordedDrive) -> PageTable:
    """Return the table of frames received by message."""
    rows = [
        (
            heard.message,
            number(heard.frames, 0, f"receptions.{i}.frames"),
            number(heard.accepted, 0, f"receptions.{i}.accepted"),
            ", ".join(f"{word} {count}" for word, count in heard.failures.items()),
            f"{heard.cycle_ms} ms" if heard.cycle_ms else "",
            "" if heard.longest_gap_ms is None else f"{heard.longest_gap_ms:.1f} ms",
            number(heard.late, 0, f"receptions.{i}.late"),
        )
        for i, heard in enumerate(drive.receptions)
    ]
    note = (
        f"{drive.frames} frames in the log, those of other messages included. Neither accepted nor "
        "refused: replaced by a newer one before the tick, or in sequence as the receiver starts."
    )
    columns = ("message", "frames", "accepted", "refused by", "cycle time", "longest gap", "late")
    return PageTable("Received", columns, rows, note=note)


def _events(drive: RecordedDrive) -> list[PageTable]:
    modes = [(number(change.t, 2, ""), change.mode) for change in drive.modes]
    codes = [
        (seen.name, number(seen.first, 2, ""), number(seen.last, 2, ""), str(seen.ticks))
        for seen in drive.codes
    ]
    tables = [PageTable("Modes", ("from (s)", "mode"), modes)]
    if codes:
        tables.append(PageTable("Fault codes", ("code", "first (s)", "last (s)", "ticks"), codes))
    return tables


def _figures(drive: RecordedDrive) -> list[Figure]:
    ticks, degrees = drive.ticks, float(np.degrees(1))

    def over_time(name: str, title: str, unit: str, curves: Sequence[Series]) -> Figure:
        return Figure(name, title, "time (s)", unit, curves, unit="s", group="control")

    def estimated(name: str, title: str, unit: str, scale: float = 1.0) -> Figure:
        values: Vector = ticks[name] * scale
        return over_time(name, title, unit, [Series("estimated", ticks["t"], values, 1, 0, "step")])

    figures = [
        estimated("roll", "Roll angle, estimated", "deg", degrees),
        estimated("roll_rate", "Roll rate, estimated", "deg/s", degrees),
        estimated("lateral_acceleration", "Effective lateral acceleration, estimated", "m/s²"),
        over_time(
            "moment",
            "Anti-roll moment of the law",
            "N·m",
            [Series("computed", ticks["t"], ticks["moment"], 1, 0, "step")],
        ),
        Figure(
            "mode",
            "Mode",
            "time (s)",
            "",
            [Series("mode", ticks["t"], ticks["mode"].astype(float), 2, 0, "step")],
            unit="s",
            group="control",
            levels=MODES,
        ),
    ]
    by_unit: dict[str, list[Series]] = {}
    for name, values in drive.commanded.items():
        unit = drive.units.get(name, "")
        if unit:
            place = 1 + len(by_unit.get(unit, []))
            series = Series(name, drive.commanded["t"], values, place, dash(place), "step")
            by_unit.setdefault(unit, []).append(series)
    return [
        *figures,
        *(
            over_time(f"commands-{i}", "Commands that would have been sent", unit, curves)
            for i, (unit, curves) in enumerate(by_unit.items())
        ),
    ]
