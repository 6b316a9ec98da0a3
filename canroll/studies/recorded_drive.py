"""A recorded drive through the firmware, open loop: its frames, in their timing.

The recorded car never got the commands, so they do not affect what follows: estimates, modes and
fault codes are those of this drive, the commands are what the ECU would have sent.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from cantools.database import Message
from numpy.typing import NDArray

from canroll.codegen.generated.mailbox import EXTENDED
from canroll.codegen.run.backends import Backend, open_backend
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.memory_image import dtype
from canroll.codegen.run.secured import SecuredEcu
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration
from canroll.firmware.event_trigger import command_slot
from canroll.firmware.identification import RATIO_ONE
from canroll.plant_sim.can_bus.traffic.log_reader import Logged
from canroll.plant_sim.can_bus.wire import frame as wire
from canroll.plant_sim.world.spool import Rows
from canroll.reaction.fault_codes import MODES
from canroll.reaction.reaction import CodeSeen, ModeChange, codes_seen, mode_changes
from canroll.reaction.reception import Receiver, Reception
from canroll.runs.metrics import peak, rms
from canroll.runs.virtual_time import TickRows
from canroll.typing import Progress, Vector

NOTE = (
    "The recorded car did not get these commands: they have no effect on the drive, and whether "
    "they would have helped cannot be told from it."
)
REPORTED = 1000
"""Ticks between two reports of progress."""


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """Response of the ECU to a recorded drive.

    Attributes:
        frames: data frames of the channel.
        ticks: rows of :data:`canroll.runs.trace.TICK`, one per tick.
        receptions: by message of the ECU.
        commanded: signals of the command message over time: "t" in s, the others in their units.
        units: of those signals.
        modes: every change of mode.
        codes: every fault code that was active.
        errors: error frames of the channel.
        remarks: what was left out of the log.
        ratios: roll stiffness less gravity and roll damping to those of the calibration, as
            identified at the end; None where the ECU does not identify them.
    """

    frames: int
    ticks: Rows
    receptions: tuple[Reception, ...]
    commanded: Mapping[str, Vector]
    units: Mapping[str, str]
    modes: tuple[ModeChange, ...]
    codes: tuple[CodeSeen, ...]
    errors: int = 0
    remarks: tuple[str, ...] = ()
    ratios: tuple[float, float] | None = None

    @property
    def seconds(self) -> float:
        """Length of the drive."""
        return float(self.ticks["t"][-1])

    def in_mode(self, mode: str) -> float:
        """Return the share of the ticks in a mode."""
        return float(np.mean(self.ticks["mode"] == MODES.index(mode)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks for the reader."""
        silent = ", ".join(heard.message for heard in self.receptions if not heard.frames)
        return (
            NOTE,
            *self.remarks,
            *((f"error frames in the log: {self.errors}",) if self.errors else ()),
            *((f"no frame of {silent} in the log",) if silent else ()),
            *(heard.remark for heard in self.receptions if heard.remark),
        )

    @property
    def verdict(self) -> str:
        """The drive in one line."""
        shares = [(name, self.in_mode(name)) for name in MODES]
        modes = ", ".join(f"{name} {100 * share:.1f} %" for name, share in shares if share > 0)
        codes = ", ".join(seen.name for seen in self.codes) or "none"
        return (
            f"{self.seconds:.2f} s, {len(self.commanded['t'])} commands, "
            f"largest moment {peak(self.ticks['moment']):.0f} N·m; {modes}; fault codes: {codes}"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the drive as plain data."""
        return {
            "seconds": self.seconds,
            "frames": self.frames,
            "error_frames": self.errors,
            "remarks": list(self.remarks),
            "ticks": len(self.ticks),
            "commands": len(self.commanded["t"]),
            "moment_max_nm": peak(self.ticks["moment"]),
            "moment_rms_nm": rms(self.ticks["moment"]),
            "estimated_roll_max_deg": float(np.degrees(peak(self.ticks["roll"]))),
            "mode_shares": {name: self.in_mode(name) for name in MODES},
            "receptions": [asdict(heard) for heard in self.receptions],
            "modes": [asdict(change) for change in self.modes],
            "codes": [asdict(seen) for seen in self.codes],
        }


def replay(
    logged: Logged,
    calibration: Calibration,
    firmware: BusFirmware,
    command: Message,
    *,
    backend: str,
    key: bytes = DEVELOPMENT_KEY,
    progress: Progress | None = None,
) -> RecordedDrive:
    """Pass the frames of a log to the firmware at their times, and tick it from the first one on.

    Args:
        logged: one channel of a log.
        calibration: calibration of the ECU.
        firmware: firmware for the bus of the log.
        command: command message of the calibrated actuator in the DBC.
        backend: backend that runs the firmware.
        key: of the authentication, on a bus whose frames are authenticated.
        progress: called with the activity and the fraction done.

    Raises:
        CanrollError: the log has no frame of the ECU, or is shorter than a tick.
    """
    keys = _identifiers(logged, firmware)
    tick_ns = 1000 * calibration.tick_us
    count = int(logged.received_ns[-1]) // tick_ns
    if count < 1:
        raise CanrollError(f"the log is shorter than one tick of {tick_ns / 1e6:g} ms")
    ecu = open_backend(backend, calibration, firmware, key=key)
    ident = firmware.sent[command_slot(calibration)][0]
    rows, sent, receiver = TickRows(firmware.record), [], Receiver(firmware, calibration)
    place = 0
    for number in range(1, count + 1):
        t = number * tick_ns
        while place < len(keys) and logged.received_ns[place] <= t:
            if keys[place] in firmware.slots:
                heard, length = int(keys[place]), int(logged.length[place])
                payload, refused = logged.payload[place, :length], _refused(ecu)
                ecu.receive(heard, payload, length)
                receiver.received(heard, payload.tobytes(), authentic=_refused(ecu) == refused)
            place += 1
        sent += [(t * 1e-9, payload) for name, payload in ecu.tick(1) if name == ident]
        image = ecu.image()
        receiver.ticked(image)
        rows.add(t * 1e-9, image)
        if progress is not None and number % REPORTED == 0:
            progress("recorded drive", number / count)
    ticks = rows.rows()
    return RecordedDrive(
        frames=len(keys),
        ticks=ticks,
        receptions=receiver.receptions(
            {key: logged.received_ns[keys == key] for key in firmware.slots}
        ),
        commanded=_commanded(sent, command),
        units={signal.name: signal.unit or "" for signal in command.signals},
        modes=mode_changes(ticks),
        codes=codes_seen(ticks),
        errors=len(logged.errors_ns),
        remarks=logged.remarks,
        ratios=_identified(ecu.image(), firmware) if calibration.identification else None,
    )


def _refused(ecu: Backend) -> int:
    return ecu.refused if isinstance(ecu, SecuredEcu) else 0


def _identified(image: bytes, firmware: BusFirmware) -> tuple[float, float]:
    """Return the two ratios of the ECU's recursive least squares from its state record."""
    theta = np.frombuffer(image, dtype(firmware.record))["theta"][0]
    return float(theta[0]) / RATIO_ONE, float(theta[1]) / RATIO_ONE


def _identifiers(logged: Logged, firmware: BusFirmware) -> NDArray[np.int64]:
    """Return each frame's identifier as the firmware's, −1 for remote frames."""
    keys = np.where(logged.flags & wire.EXTENDED, logged.ident | EXTENDED, logged.ident)
    keys = np.where(logged.flags & wire.REMOTE, -1, keys)
    if not np.isin(keys, list(firmware.slots)).any():
        names = ", ".join(firmware.bus.received[slots[0]].name for slots in firmware.slots.values())
        raise CanrollError(
            f"the log has none of the frames that the ECU receives ({names}): "
            "--dbc and --map describe another bus"
        )
    return keys


def _commanded(sent: list[tuple[float, bytes]], command: Message) -> dict[str, Vector]:
    rows = [command.decode(payload, decode_choices=False) for _, payload in sent]
    assert all(isinstance(row, dict) for row in rows)
    times = np.array([t for t, _ in sent])
    return {
        "t": times,
        **{
            signal.name: np.array([float(row[signal.name]) for row in rows])
            for signal in command.signals
        },
    }
