"""A plot as data for ``plot.js``, packed compactly for embedding in the page."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

POINTS_MAX = 4000
POINTS_OF = {"line": POINTS_MAX, "step": 10 * POINTS_MAX, "marks": 10 * POINTS_MAX}
"""The most points of a curve, by kind: of a line those of one screen, of instants many."""
OVERVIEW = "overview"
"""The group of the figures below the verdict."""
SOLID, DASHED, DOTTED, DASH_DOTTED = range(4)


def pack(values: ArrayLike) -> str:
    """Return values as base64 of little-endian float32."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")


def thin(x: NDArray[Any], y: NDArray[Any], points: int = POINTS_MAX) -> tuple[Any, Any]:
    """Return both ends of a curve and the smallest and largest value of each stretch.

    They are at most ``points``, and the ends.
    """
    return thin_pieces([(x, y)], len(x), points)


def thin_pieces(
    pieces: Iterable[tuple[NDArray[Any], NDArray[Any]]], count: int, points: int = POINTS_MAX
) -> tuple[Any, Any]:
    """Return :func:`thin` of a curve of ``count`` points that comes in ``pieces`` of x and y."""
    if count <= points + 2:
        x, y = zip(*pieces, strict=True)
        return np.concatenate(x), np.concatenate(y)
    stride = -(-2 * count // points)
    kept, first, x, y = [], 0, np.zeros(0), np.zeros(0)
    for piece in pieces:
        x, y = np.append(x, piece[0]), np.append(y, piece[1])
        last = first + len(x) == count
        full = len(x) // stride * stride
        blocks = np.reshape(y[:full], (-1, stride))
        ends = np.stack([np.argmin(blocks, axis=1), np.argmax(blocks, axis=1)], axis=1)
        picks = (ends + np.arange(len(blocks))[:, None] * stride).ravel()
        # both ends of the curve remain, whatever their values
        picks = np.append(picks, ([0] if first == 0 else []) + ([len(x) - 1] if last else []))
        picks = picks.astype(int)
        kept.append((first + picks, x[picks], y[picks]))
        x, y, first = x[full:], y[full:], first + full
    places, x, y = (np.concatenate(part) for part in zip(*kept, strict=True))
    _, picks = np.unique(places, return_index=True)
    return x[picks], y[picks]


@dataclass(frozen=True, slots=True)
class Series:
    """One curve, or marks, or bars.

    ``kind``: "line", "step" (held until the next x), "marks" (instants along the axis, ``row``
    above each other), "bars" (from x to x + ``width``) or "spans" (along the level that y
    numbers). ``colour`` is 0 to 7 of the page's palette, ``dash`` one of the patterns, so that
    curves differ in more than colour.
    """

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    colour: int
    dash: int = SOLID
    kind: str = "line"
    width: float = 0.0
    row: int = 0

    def __post_init__(self) -> None:
        """Keep no more points than the plot can show."""
        if self.kind in POINTS_OF:
            x, y = thin(self.x, self.y, POINTS_OF[self.kind])
            object.__setattr__(self, "x", x)
            object.__setattr__(self, "y", y)

    def data(self) -> dict[str, object]:
        """Return the data for the page."""
        return _as_dict(self) | {"x": pack(self.x), "y": pack(self.y)}


@dataclass(frozen=True, slots=True)
class Figure:
    """One plot. ``linked`` ones share range and cursor; ``equal`` ones are maps, not functions.

    With ``zero`` the y axis starts at 0; with ``levels`` it shows their names instead, the first at
    the top.
    """

    id: str
    title: str
    xlabel: str
    ylabel: str
    series: Sequence[Series]
    unit: str = ""
    note: str = ""
    group: str = "motion"
    linked: bool = True
    equal: bool = False
    zero: bool = False
    levels: Sequence[str] = ()

    def data(self) -> dict[str, object]:
        """Return the data for the page."""
        return _as_dict(self) | {"series": [series.data() for series in self.series]}


def _as_dict(record: Series | Figure) -> dict[str, object]:
    """Return the fields by name, without the copies that dataclasses.asdict makes."""
    return {field.name: getattr(record, field.name) for field in fields(record)}


def histogram(name: str, values: NDArray[Any], *, colour: int, bins: int = 40) -> Series:
    """Return the share of values (%) in each of ``bins`` equal stretches, as bars."""
    counts, edges = np.histogram(values, bins=bins)
    share = 100 * counts / max(len(values), 1)
    return Series(name, edges[:-1], share, colour, SOLID, "bars", float(edges[1] - edges[0]))


def distribution(name: str, values: NDArray[Any], *, colour: int, dash: int = SOLID) -> Series:
    """Return the share of values (%) that do not exceed x, as a step curve of 201 quantiles."""
    share = np.linspace(0, 100, 201)
    return Series(name, np.percentile(values, share), share, colour, dash, "step")
