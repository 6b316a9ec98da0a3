"""A bus log: its inferred messages, and the effect of additional ones on them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from canroll.network import COMMANDS
from canroll.network.analysis import AnalysisOptions, delay_over
from canroll.network.answer import Answer, LoopNames, MessageRow, SegmentAnswer, Times
from canroll.network.as_json import log_json
from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.can_bus.bounds.recorded_load import effects
from canroll.plant_sim.can_bus.network.own_frames import messages_of, own_messages
from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.simulation.response_times import NetworkSimulation
from canroll.plant_sim.can_bus.traffic.added_messages import joined, missing_from
from canroll.plant_sim.can_bus.traffic.inference import InferredBus, infer_buses
from canroll.plant_sim.can_bus.traffic.log_reader import Progress
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import REMOTE

_MANY_TOO_CLOSE = 0.01
"""Share of frames that come sooner than the bit rate allows, from which it is reported."""


@dataclass(frozen=True, slots=True)
class Added:
    """Messages that come onto a recorded bus: the given ones, or ours in the frames of a profile.

    ``name``: how they are called together.
    """

    name: str
    profile: BusProfile
    given: Sequence[BusMessage] | None = None

    def messages(self, command: str) -> Sequence[BusMessage]:
        """Return the messages with one command, as ours include one at a time."""
        return own_messages(command, self.profile) if self.given is None else self.given

    def loop(self, options: AnalysisOptions, bus: InferredBus | None = None) -> LoopNames:
        """Return the loop over them, with our command that ``bus`` already has if it has one."""
        if self.given is not None:
            return options.loop(self.given)
        ours = messages_of(self.profile)
        recorded = [
            message
            for message in ours
            if bus and message.name in COMMANDS and not missing_from(bus, [message])
        ]
        return options.loop(recorded or ours)


@dataclass(frozen=True, slots=True)
class ExtendedLog:
    """A bus log, on every channel of which messages are added.

    ``channel`` None: all; ``section``: of a log whose times step.
    """

    path: Path
    added: Added
    channel: str | None = None
    bitrate: int | None = None
    data_bitrate: int | None = None
    section: int | None = None

    def analyse(self, options: AnalysisOptions, progress: Progress) -> list[Answer]:
        """Return the result of every channel."""
        options.check_names(self.added.messages(self.added.loop(options).command))
        buses = infer_buses(
            self.path,
            channel=self.channel,
            bitrate=self.bitrate,
            data_bitrate=self.data_bitrate,
            section=self.section,
            progress=progress,
        )
        return [self._answer(bus, options) for bus in buses]

    def as_json(self, answers: Sequence[Answer]) -> dict[str, Any]:
        """Return the JSON object of the results, by channel."""
        return {"channels": {a.segments[0].name: log_json(a) for a in answers}}

    def _answer(self, bus: InferredBus, options: AnalysisOptions) -> Answer:
        loop = self.added.loop(options, bus)
        messages = self.added.messages(loop.command)
        rates = {"bitrate": bus.bitrate, "data_bitrate": bus.data_bitrate}
        everything = RoutedNetwork.one_bus(joined(bus, messages), **rates)
        # no ages: the log may have frames of our own messages, which would be sent twice
        delay = delay_over(everything, loop, replace(options, duration_s=0.0))
        added = RoutedNetwork.one_bus(missing_from(bus, messages), **rates)
        if delay is not None:
            added = added.in_every_tick(loop.command, tick_ms=loop.tick_ms)
        simulation = options.simulate(added, bus.recording)
        rows = _rows(bus, added, simulation, options)
        segment = SegmentAnswer(
            bus.channel,
            **rates,
            rows=rows,
            load=None if simulation is None else simulation.loads[0],
            frames=0 if simulation is None else simulation.frames[0],
        )
        return Answer(
            self.path.name,
            (segment,),
            loop,
            delay,
            head=_head(self.path.name, segment, bus),
            added=self.added.name,
            warnings=bus.recording.remarks,
            notes=tuple(_notes(bus, rows)),
            facts=_facts(bus),
        )


def _rows(
    bus: InferredBus,
    added: RoutedNetwork,
    simulation: NetworkSimulation | None,
    options: AnalysisOptions,
) -> list[MessageRow]:
    """Return the recorded and the added messages in the order of arbitration."""
    simulated: dict[str, Times] = {}
    if simulation is not None:
        for r, arrival in zip(added.messages, simulation.arrivals, strict=True):
            simulated[r.message.name] = Times.of(arrival[0].here)
    messages = [r.message for r in added.messages]
    rows = []
    for effect in effects(bus, messages, errors=options.errors):
        times = Times() if effect.seen else simulated.get(effect.message.name, Times())
        row = MessageRow(effect.after, times, (bus.channel,), effect.after.bound_ns, times)
        rows.append(
            replace(row, evidence=effect.seen, before=effect.before, assumes=effect.assumes)
        )
    return rows


def _remote(bus: InferredBus) -> int:
    """Return the number of remote frames in the log."""
    return int((bus.recording.frames.flags & REMOTE != 0).sum())


def _facts(bus: InferredBus) -> dict[str, Any]:
    """Return the keys of the JSON object on the channel itself."""
    return {
        "too_close": bus.too_close,
        "duration_s": bus.recording.duration_s,
        "frames": len(bus.recording.frames.t_ns),
        "remote_frames": _remote(bus),
        "error_frames": bus.recording.errors,
        "remarks": list(bus.recording.remarks),
    }


def _head(name: str, segment: SegmentAnswer, bus: InferredBus) -> str:
    """Return the line on frames and bit rate of the channel."""
    remote = f" ({_remote(bus)} of them remote)" if _remote(bus) else ""
    line = (
        f"{name}, channel {bus.channel}: {len(bus.recording.frames.t_ns)} frames{remote} in"
        f" {bus.recording.duration_s:g} s at {segment.kilobits} kbit/s"
    )
    if bus.too_close > _MANY_TOO_CLOSE:
        line += (
            f"\n{bus.too_close:.1%} of the frames come sooner than that rate allows: the times"
            " of the log are those of a driver, or the rate is higher"
        )
    return line


def _notes(bus: InferredBus, rows: Sequence[MessageRow]) -> list[str]:
    """Return the lines on what is not periodic, and on errors."""
    lines = []
    events = [m for m in bus.messages if m.assumed]
    if events:
        counts = (f"{m.message.ident:X} ({m.frames})" for m in events)
        lines.append(f"event-driven (frames): {', '.join(counts)}")
    if any(row.assumes for row in rows):
        lines.append("* assuming these are no more frequent than in the log")
    if bus.recording.errors:
        frames = "error frame" if bus.recording.errors == 1 else "error frames"
        lines.append(
            f"{bus.recording.errors} {frames} in the log: allow for them by --error-interval"
        )
    return lines
