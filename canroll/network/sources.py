"""What can be analysed: a traffic set, a network."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canroll.network.analysis import AnalysisOptions, delay_over, segments_of
from canroll.network.answer import Answer
from canroll.network.as_json import network_json, set_json
from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.can_bus.bounds.delay_bounds import loop_network
from canroll.plant_sim.can_bus.network.own_frames import messages_of, own_messages
from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.traffic.files import Traffic
from canroll.plant_sim.can_bus.traffic.log_playback import Recording, load_recording
from canroll.plant_sim.can_bus.traffic.log_reader import Progress
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED


@dataclass(frozen=True, slots=True)
class BusReplay:
    """A log that is replayed with a traffic set: its file, and channel and section of it."""

    path: Path
    channel: str | None
    section: int | None

    def read(self, traffic: Traffic, progress: Progress) -> Recording:
        """Return the frames other than those of the set."""
        return load_recording(
            self.path,
            bitrate=traffic.bitrate,
            data_bitrate=traffic.data_bitrate,
            leave_out={(m.ident, bool(m.flags & EXTENDED)) for m in traffic.messages},
            channel=self.channel,
            section=self.section,
            progress=progress,
        )

    def notes(self, recording: Recording, duration_s: float) -> list[str]:
        """Return the lines on what is not replayed."""
        name = self.path.name
        lines = [f"{name}: {remark}" for remark in recording.remarks]
        if recording.errors:
            lines.append(f"error frames in {name}, not replayed: {recording.errors}")
        if recording.duration_s < duration_s:
            lines.append(f"{name} ends after {recording.duration_s:g} s of {duration_s:g} s")
        return lines


@dataclass(frozen=True, slots=True)
class TrafficSet:
    """A traffic set: a network of one segment.

    ``offsets``: the messages of one node keep their offsets in the bounds.
    """

    name: str
    traffic: Traffic
    offsets: bool = False
    replay: BusReplay | None = None

    def analyse(self, options: AnalysisOptions, progress: Progress) -> list[Answer]:
        """Return the result of the set."""
        traffic = self.traffic
        options.check_names(traffic.messages)
        loop = options.loop(traffic.messages)
        recording = None if self.replay is None else self.replay.read(traffic, progress)
        network = RoutedNetwork.one_bus(
            traffic.messages, bitrate=traffic.bitrate, data_bitrate=traffic.data_bitrate
        )
        notes = self._notes()
        if self.replay is not None and recording is not None:
            notes += self.replay.notes(recording, options.duration_s)
        answer = Answer(
            self.name,
            segments_of(network, options, recording=recording, offsets=self.offsets),
            loop,
            delay_over(network, loop, options, recording),
            warnings=traffic.warnings,
            notes=tuple(notes),
            facts={
                "recording": None if recording is None else _recording_json(recording),
                "warnings": list(traffic.warnings),
            },
        )
        return [answer]

    def as_json(self, answers: Sequence[Answer]) -> dict[str, Any]:
        """Return the JSON object of the result."""
        return set_json(answers[0])

    def _notes(self) -> list[str]:
        """Return the lines on what the set lacks."""
        lines, traffic = [], self.traffic
        if traffic.left_out:
            lines.append(
                "without a cycle time (GenMsgCycleTime), left out:"
                f" {', '.join(traffic.left_out)} (--period MS)"
            )
        if not traffic.data_bitrate and any(m.flags & BIT_RATE_SWITCH for m in traffic.messages):
            lines.append(
                "no data bit rate in the set: FD data are sent at the nominal rate"
                " (--data-bitrate B)"
            )
        return lines


def _recording_json(recording: Recording) -> dict[str, Any]:
    return {
        "frames": len(recording.frames.t_ns),
        "duration_s": recording.duration_s,
        "channel": recording.channel,
        "error_frames": recording.errors,
        "remarks": list(recording.remarks),
    }


@dataclass(frozen=True, slots=True)
class BusNetwork:
    """A built-in bus, or the network of a file, with our messages and its background."""

    name: str
    profile: BusProfile

    def analyse(self, options: AnalysisOptions, progress: Progress) -> list[Answer]:
        """Return the result of the network, with the command in every tick."""
        loop = options.loop(messages_of(self.profile))
        options.check_names(own_messages(loop.command, self.profile))
        network = loop_network(
            self.profile,
            command=loop.command,
            command_period_ms=loop.tick_ms,
            seed=options.seed,
        )
        segments = segments_of(network, options)
        return [Answer(self.name, segments, loop, delay_over(network, loop, options))]

    def as_json(self, answers: Sequence[Answer]) -> dict[str, Any]:
        """Return the JSON object of the result."""
        return network_json(answers[0])
