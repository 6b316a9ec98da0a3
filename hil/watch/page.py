"""The page of a running watch: tiles, plots, events and messages, filled over a socket.

This module assigns tracks and columns to curves; :mod:`hil.watch.stream` defines the tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from canroll.reaction.fault_codes import FAULT_CODES, MODES
from canroll.report.document import PLOT_STYLES, PLOTS, document
from canroll.report.figure import DASH_DOTTED, DASHED, DOTTED, SOLID, Figure, Series
from hil.watch.observation import (
    COMMAND_TO_ACKNOWLEDGEMENT,
    IMU_TO_COMMAND,
    SILENT,
)
from hil.watch.stream import KEPT

SPANS = (10, 30, 60)
"""Lengths of time that the plots can show, s."""
FAULTS_GAP = 1.25
"""Active fault codes come every 0.5 s, with one page in five of the diagnostics."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve of a live plot: the sum of ``columns`` of a track, times ``scale``."""

    name: str
    track: str
    columns: Sequence[int]
    colour: int
    dash: int = SOLID
    kind: str = "line"
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Plot:
    """A live plot, and the minimum range of its y axis."""

    id: str
    title: str
    unit: str
    curves: Sequence[Curve]
    least: float = 0.0
    zero: bool = False
    levels: Sequence[str] = ()
    note: str = ""

    def data(self) -> dict[str, object]:
        """Return the input of the scripts: the figure without data, and its curves' sources."""
        none = np.zeros(0)
        figure = Figure(
            self.id,
            self.title,
            "time since start of the watch (s)",
            self.unit,
            [Series(c.name, none, none, c.colour, c.dash, c.kind) for c in self.curves],
            unit="s",
            note=self.note,
            zero=self.zero,
            least=self.least,
            levels=self.levels,
        )
        sources = [
            {
                "track": curve.track,
                "columns": list(curve.columns),
                "scale": curve.scale,
                "gap": FAULTS_GAP if curve.track == "faults" else SILENT,
            }
            for curve in self.curves
        ]
        return {**figure.data(), "sources": sources}


@dataclass(frozen=True, slots=True)
class Tile:
    """A number on top of the page; ``key`` is its key among the values of a message."""

    name: str
    key: str
    unit: str
    digits: int = 0
    signed: bool = False
    scale: float = 1.0


TILES = (
    Tile("roll angle, estimated", "roll_estimate_deg", "°", 2, signed=True),
    Tile("lateral acceleration", "lateral_acceleration_m_s2", "m/s²", 2, signed=True),
    Tile("speed", "speed_km_h", "km/h", 1),
    Tile("bus load", "load", "%", 1, scale=100.0),
    Tile("commands per sample", "commands_per_sample", "", 2),
    Tile("moment, commanded", "moment_command_nm", "N·m", signed=True),
    Tile("delivered, front", "moment_delivered_nm.0", "N·m", signed=True),
    Tile("delivered, rear", "moment_delivered_nm.1", "N·m", signed=True),
    Tile("Imu to command", "imu_to_command_ms.median", "ms, median", 1),
)
"""Rates, delays and the load are those of the last two seconds."""


def plots(bitrate: int, *, assumed: bool) -> list[Plot]:
    """Return the plots, in order.

    Args:
        bitrate: bit rate of the bus, bit/s.
        assumed: whether the bit rate is an assumption.
    """
    source = "assumed, not given by -b" if assumed else "as given"
    return [
        Plot(
            "roll", "Roll angle", "deg",
            [
                Curve("true (simulation only)", "reference", [0], 0, DASHED),
                Curve("estimated by the controller", "status", [0], 1),
            ],
            least=0.2,
        ),
        Plot(
            "moment", "Anti-roll moment", "N·m",
            [
                Curve("delivered", "delivered", [0, 1], 2),
                Curve("front", "delivered", [0], 3, DASHED),
                Curve("rear", "delivered", [1], 4, DASH_DOTTED),
                Curve("commanded", "status", [1], 1, DOTTED, "step"),
            ],
            least=100.0,
        ),
        Plot(
            "modes", "Mode and fault codes", "",
            [
                Curve("mode", "status", [2], 1, kind="spans"),
                Curve("fault code active", "faults", [0], 2, kind="spans"),
            ],
            levels=MODES,
            note="fault codes are sent twice a second; see the events for shorter ones",
        ),
        Plot(
            "delays", "Delays seen on the bus", "ms",
            [
                Curve("latest Imu frame to command frame", IMU_TO_COMMAND, [0], 1),
                Curve(
                    "command frame to its acknowledgement", COMMAND_TO_ACKNOWLEDGEMENT, [0], 2,
                    DASHED,
                ),
            ],
            zero=True,
            least=10.0,
            note="according to the time stamps of the watching interface; a command may use an "
                 "older sample",
        ),
        Plot("rate", "Roll rate", "deg/s", [Curve("Imu", "imu", [0], 1)], least=0.5),
        Plot("ay", "Lateral acceleration", "m/s²", [Curve("Imu", "imu", [1], 1)], least=0.5),
        Plot(
            "steer", "Steering wheel", "deg", [Curve("VehicleMotion", "motion", [1], 1)], least=5.0
        ),
        Plot("speed", "Speed", "km/h", [Curve("VehicleMotion", "motion", [0], 1)], zero=True),
        Plot(
            "load", "Bus load", "%",
            [Curve("all frames seen", "load", [0], 1, kind="step", scale=100.0)],
            zero=True,
            least=5.0,
            note=f"share of each 100 ms at {bitrate / 1000:g} kbit/s ({source})",
        ),
    ]  # fmt: skip


def live_page(*, bitrate: int, assumed: bool) -> str:
    """Return the page as one HTML document, which only requests the socket ``/live``.

    Args:
        bitrate: bit rate of the bus, bit/s.
        assumed: whether the bit rate is an assumption.
    """
    data = {
        "figures": [plot.data() for plot in plots(bitrate, assumed=assumed)],
        "modes": MODES,
        "faults": FAULT_CODES,
        "kept": KEPT,
    }
    return document(
        "live.html",
        "Roll control, live",
        styles=(*PLOT_STYLES, "live.css"),
        scripts=(*PLOTS, "live.js"),
        data={"data": data},
        tiles=TILES,
        spans=SPANS,
    )
