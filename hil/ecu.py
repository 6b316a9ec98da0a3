"""The ECU as the closed loop sees it: frames in, frames out, a state to look at."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from firmware import calibration as formats
from firmware import ecu as firmware
from firmware.calibration import Calibration
from firmware.signals import RX_IDS, TX_IDS, TX_LENGTHS
from firmware.state import GYRO_BIAS, LATERAL, LATERAL_RATE, ROLL, ROLL_RATE, Ecu

Frame = tuple[int, bytes]

SLOT = {ident: slot for slot, ident in enumerate(RX_IDS) if ident}


class Backend(Protocol):
    """One running ECU, whatever runs it."""

    def receive(self, ident: int, payload: NDArray[np.uint8], length: int) -> None:
        """Put a received frame in its mailbox; an identifier that nobody waits for is ignored."""

    def tick(self, elapsed_ticks: int) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""

    @property
    def state(self) -> Ecu:
        """The state record, to be read only."""


class PythonEcu:
    """The firmware run by CPython, line by line."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._ecu = Ecu()
        refused = firmware.init(self._ecu, calibration)
        if refused:
            raise CanrollError(f"the ECU refuses the calibration: rule {refused} of its check")

    @property
    def state(self) -> Ecu:
        """The state record, to be read only."""
        return self._ecu

    def receive(self, ident: int, payload: NDArray[np.uint8], length: int) -> None:
        """Put a received frame in its mailbox; an identifier that nobody waits for is ignored."""
        slot = SLOT.get(ident)
        if slot is not None:
            firmware.receive(self._ecu, slot, payload.tolist(), length)

    def tick(self, elapsed_ticks: int) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""
        ecu = self._ecu
        firmware.tick(ecu, self._calibration, elapsed_ticks)
        frames = []
        for slot, pending in enumerate(ecu.tx_pending):
            if pending:
                frames.append((TX_IDS[slot], bytes(ecu.tx_payload[slot][: TX_LENGTHS[slot]])))
                ecu.tx_pending[slot] = 0
        return frames


BACKENDS = {"python": PythonEcu}


def open_ecu(backend: str, calibration: Calibration) -> Backend:
    """Start an ECU.

    Raises:
        UnknownNameError: no such backend.
        CanrollError: the ECU refuses the calibration.
    """
    if backend not in BACKENDS:
        raise UnknownNameError("backend", backend, BACKENDS)
    return BACKENDS[backend](calibration)


def record_tick(row: np.void, t: float, state: Ecu) -> None:
    """Fill one entry of :data:`hil.trace.TICK` from the state after a tick at ``t`` seconds."""
    row["t"] = t
    row["mode"] = state.mode
    row["triggered"] = state.triggered
    row["troubles"] = state.trouble_active
    row["moment"] = state.moment / 2**formats.Q_MOMENT
    row["outputs"] = [value / 2**formats.Q_MOMENT for value in state.outputs]
    row["roll"] = state.x[ROLL] / 2**formats.Q_ANGLE
    row["roll_rate"] = state.x[ROLL_RATE] / 2**formats.Q_RATE
    row["lateral_acceleration"] = state.x[LATERAL] / 2**formats.Q_ACCELERATION
    row["lateral_rate"] = state.x[LATERAL_RATE] / 2**formats.Q_ACCELERATION
    row["gyro_bias"] = state.x[GYRO_BIAS] / 2**formats.Q_RATE
