"""Time lines of a log: cut where its times step, and joined where they go on.

The clock of a logger is set while it runs, two recordings are one file, or the logger slept for
days. The log is cut at every jump back, at every long pause, and at a pause that a jump back
undoes. Pieces that follow each other within a pause's length are joined; of all ways to do so the
one with most frames is a section, and what remains is treated likewise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError

_DISORDER_NS: Final = 20_000_000
"""By how much frames of one channel may be out of order: loggers write in pieces."""
_PAUSE_NS: Final = 60_000_000_000
"""Longest pause within a drive; what python-can's player skips, too."""
_TYPICAL_PAUSES: Final = 100
"""Medians of the times between frames that are no long pause on a bus that says little."""
_FEW: Final = 10
_DECREASING: Final = 0.2
"""Share of frames before the previous one; of differences for times it is nearly half."""
_NO_TIMES: Final = (
    "they are no times of reception (of candump -t d they are differences: record with -L)"
)
_NEGATED: Final = "they fall throughout, as with their sign changed: take the minus off"
_MOST_JUMPS: Final = 100
_SHARE: Final = 0.01
"""Jumps back, at most, and of all frames if there are few: a clock is not set more often."""
_LEFT_OUT: Final = 16
"""Pieces that may lie between two on one time line."""
_SHOWN: Final = 3


@dataclass(frozen=True, slots=True)
class TimeStep:
    """A step of the times at a frame (index in the log), ns; negative: back."""

    frame: int
    by_ns: int

    def __str__(self) -> str:
        way = "forward" if self.by_ns > 0 else "back"
        return f"{way} by {_spell(abs(self.by_ns))} at frame {self.frame + 1}"


@dataclass(frozen=True, slots=True)
class Sections:
    """Sections of a log: indices of their frames in the log's order, and where its times step."""

    rows: Sequence[NDArray[np.int64]]
    steps: Sequence[TimeStep]

    def choose(self, number: int | None) -> tuple[NDArray[np.int64], str]:
        """Return the rows of a section, None: the one with most frames, and what to say of it."""
        sizes = [len(rows) for rows in self.rows]
        place = int(np.argmax(sizes)) if number is None else number - 1
        if len(self.rows) == 1:
            return self.rows[0], ""
        shown = ", ".join(map(str, self.steps[:_SHOWN]))
        more = len(self.steps) - _SHOWN
        return self.rows[place], (
            f"the times step {shown}{f' and {more} times more' if more > 0 else ''}: section"
            f" {place + 1} of {len(self.rows)} is read, {sizes[place]} of {sum(sizes)} frames on"
            " one time line ('canroll bus' and 'canroll ecu' read another by --section)"
        )


def find_sections(times_ns: NDArray[np.int64]) -> Sections:
    """Return the sections of a channel; times in the order of the log.

    Raises:
        CanrollError: the times step so often that they are no times of reception.
    """
    gaps = np.diff(times_ns)
    backs = np.flatnonzero(gaps < -_DISORDER_NS) + 1
    decreasing = int((gaps < 0).sum())
    if decreasing > max(_FEW, _DECREASING * len(times_ns)):
        raise CanrollError(
            f"the times of {decreasing} of {len(times_ns)} frames are before those of the frame"
            f" before: {_NEGATED if decreasing == len(gaps) else _NO_TIMES}"
        )
    if len(times_ns) > _FEW and not gaps.any():
        raise CanrollError(f"all {len(times_ns)} frames have the same time")
    if len(backs) > min(_MOST_JUMPS, max(2.0, _SHARE * len(times_ns))):
        raise CanrollError(
            f"the times jump back {len(backs)} times in {len(times_ns)} frames: {_NO_TIMES}"
        )
    forward = gaps[gaps > 0]
    typical = int(np.median(forward)) if len(forward) else 0
    longest = max(_PAUSE_NS, _TYPICAL_PAUSES * typical)
    pauses = set((np.flatnonzero(gaps > longest) + 1).tolist())
    bounds = [0, *backs.tolist(), len(times_ns)]
    for place, back in enumerate(backs.tolist(), 1):
        pauses |= _undone(gaps, bounds[place - 1], back, bounds[place + 1])
    cuts = sorted({*backs.tolist(), *pauses})
    steps = [TimeStep(cut, int(gaps[cut - 1])) for cut in cuts]
    pieces = np.split(np.arange(len(times_ns)), cuts)
    rows = []
    while pieces:
        before = _before(pieces, times_ns, longest)
        joined = {i for later, earlier in enumerate(before) for i in (later, *earlier) if earlier}
        alone = [i for i in range(len(pieces)) if i not in joined]
        chain = _longest_chain(pieces, before)
        rows += [pieces[i] for i in alone if i not in chain]
        rows.append(np.concatenate([pieces[i] for i in chain]))
        pieces = [piece for i, piece in enumerate(pieces) if i not in {*chain, *alone}]
    return Sections(sorted(rows, key=lambda section: int(section[0])), steps)


def _undone(gaps: NDArray[np.int64], begin: int, back: int, end: int) -> set[int]:
    """Return the first frame after the nearest pause as long as a jump back, before and after it.

    A clock that is set for a while makes a pause longer and a jump shorter by the time between
    two frames.
    """
    jump = -gaps[back - 1]
    matching = np.flatnonzero((gaps >= jump) & (gaps <= 2 * jump)) + 1
    before = matching[(matching > begin) & (matching < back)]
    after = matching[(matching > back) & (matching < end)]
    return {*before[-1:].tolist(), *after[:1].tolist()}


def _before(
    pieces: Sequence[NDArray[np.int64]], times_ns: NDArray[np.int64], longest: int
) -> list[list[int]]:
    """Return for every piece those before it that it goes on after, on one time line."""
    starts = [int(times_ns[piece[0]]) for piece in pieces]
    ends = [int(times_ns[piece].max()) for piece in pieces]
    return [
        [i for i in range(max(0, j - _LEFT_OUT), j) if -_DISORDER_NS <= start - ends[i] <= longest]
        for j, start in enumerate(starts)
    ]


def _longest_chain(
    pieces: Sequence[NDArray[np.int64]], before: Sequence[Sequence[int]]
) -> list[int]:
    """Return the pieces, in order, that fit onto one time line and have most frames."""
    sizes: list[int] = []
    links: list[int] = []
    for piece, earlier in zip(pieces, before, strict=True):
        best = max(earlier, key=lambda i: sizes[i], default=-1)
        links.append(best)
        sizes.append(len(piece) + (sizes[best] if best >= 0 else 0))
    chain = [int(np.argmax(sizes))]
    while links[chain[-1]] >= 0:
        chain.append(links[chain[-1]])
    return chain[::-1]


def _spell(time_ns: int) -> str:
    """Return a time in a unit that suits it."""
    units = ((86_400e9, "d"), (3600e9, "h"), (60e9, "min"), (1e9, "s"), (1e6, "ms"))
    size, unit = next((u for u in units if time_ns >= u[0]), units[-1])
    return f"{time_ns / size:.4g} {unit}"
