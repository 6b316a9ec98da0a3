"""Are the frames that closed_loop.py prints those of a log of ``canroll run``?

python same_frames.py loop.txt out/bus.asc

A frame ends at every terminal of the bus but its sender's; the log has it once, to the microsecond.
Exit code 1 where they differ.
"""

import sys
from pathlib import Path

import can

BUS = "bus.fmu:"
MICROSECOND = 1000


def main(loop: str, log: str) -> int:
    """Compare and say how many frames there are."""
    lines = [line.split(" ") for line in Path(loop).read_text().splitlines()]
    end = int(lines[-1][0])
    delivered = dict.fromkeys(
        (int(now) // MICROSECOND, int(ident, 16), data)
        for now, port, ident, data in lines
        if port.startswith(BUS)
    )
    with can.LogReader(log) as reader:
        logged = [
            (round(1e6 * frame.timestamp), frame.arbitration_id, frame.data.hex())
            for frame in reader
            if not frame.is_error_frame and 1e9 * frame.timestamp < end
        ]
    matching = len(delivered) == len(logged) and all(
        one[1:] == other[1:] and abs(one[0] - other[0]) <= 1
        for one, other in zip(delivered, logged, strict=True)
    )
    verdict = "the same" if matching else "not the same"
    print(f"{len(delivered)} frames of FMUs, {len(logged)} of the log: {verdict}")
    return 0 if matching else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
