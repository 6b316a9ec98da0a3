"""The firmware's module ``secoc`` beside a running ECU: by CPython, as C, or on a Cortex-M."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from codegen.run import memory_image, native
from codegen.run.bus_firmware import BusFirmware
from codegen.run.unicorn import CortexEcu
from firmware.security.secoc_state import SECURED

RECORD, FRAME = 0x20008000, 0x20007100
"""Addresses on a Cortex-M of the record and of a frame."""


class Authentication(Protocol):
    """The firmware's module ``secoc`` with its record."""

    def start(self, key: bytes, reset: int, listening: int) -> None:
        """Start with a key as the start number ``reset``."""

    def resume(self, message: int, reset: int) -> None:
        """Continue with a sender."""

    def elapse(self, ticks: int) -> None:
        """Count ticks."""

    def verify(self, message: int, frame: bytes, length: int) -> bool:
        """Whether a received frame is to be taken."""

    def protect(self, slot: int, frame: bytes) -> bytes:
        """Return a frame with freshness value and MAC."""

    @property
    def refused(self) -> int:
        """Frames refused since the start."""

    @property
    def senders(self) -> Sequence[int]:
        """Number of the last known start of each message's sender."""


class PythonAuthentication:
    """The module as CPython runs it."""

    def __init__(self, firmware: BusFirmware) -> None:
        self._module = firmware.module("security.secoc")
        self._its = firmware.module("security.secoc_state").Secoc()

    def start(self, key: bytes, reset: int, listening: int) -> None:
        """Start with a key as the start number ``reset``."""
        self._module.start(self._its, list(key), reset, listening)

    def resume(self, message: int, reset: int) -> None:
        """Continue with a sender."""
        self._module.resume(self._its, message, reset)

    def elapse(self, ticks: int) -> None:
        """Count ticks."""
        self._module.elapse(self._its, ticks)

    def verify(self, message: int, frame: bytes, length: int) -> bool:
        """Whether a received frame is to be taken."""
        return bool(self._module.verify(self._its, message, list(frame), length))

    def protect(self, slot: int, frame: bytes) -> bytes:
        """Return a frame with freshness value and MAC."""
        its = list(frame)
        self._module.protect(self._its, slot, its)
        return bytes(its)

    @property
    def refused(self) -> int:
        """Frames refused since the start."""
        return int(self._its.refused)

    @property
    def senders(self) -> Sequence[int]:
        """Number of the last known start of each message's sender."""
        return tuple(self._its.rx_reset)


class NativeAuthentication:
    """The module as compiled C."""

    def __init__(self, firmware: BusFirmware) -> None:
        library = native.library_of(firmware)
        kind = memory_image.dtype(firmware.module("security.secoc_state").Secoc)
        assert library.lib.canroll_secoc_size() == kind.itemsize
        self._lib = library.lib
        self._record = np.zeros(1, kind)
        self._frame = bytearray(SECURED)
        buffer = library.ffi.from_buffer
        self._its = buffer("uint8_t[]", self._record, require_writable=True)
        self._sent = buffer("uint8_t[]", self._frame, require_writable=True)

    def start(self, key: bytes, reset: int, listening: int) -> None:
        """Start with a key as the start number ``reset``."""
        self._lib.canroll_secoc_begin(self._its, key, reset, listening)

    def resume(self, message: int, reset: int) -> None:
        """Continue with a sender."""
        self._lib.canroll_secoc_continue(self._its, message, reset)

    def elapse(self, ticks: int) -> None:
        """Count ticks."""
        self._lib.canroll_secoc_wait(self._its, ticks)

    def verify(self, message: int, frame: bytes, length: int) -> bool:
        """Whether a received frame is to be taken."""
        return bool(self._lib.canroll_secoc_judge(self._its, message, frame, length))

    def protect(self, slot: int, frame: bytes) -> bytes:
        """Return a frame with freshness value and MAC."""
        self._frame[:] = frame
        self._lib.canroll_secoc_finish(self._its, slot, self._sent)
        return bytes(self._frame)

    @property
    def refused(self) -> int:
        """Frames refused since the start."""
        return int(self._record["refused"][0])

    @property
    def senders(self) -> Sequence[int]:
        """Number of the last known start of each message's sender."""
        return tuple(self._record["rx_reset"][0].tolist())


class CortexAuthentication:
    """The module on an ECU's emulated Cortex-M; ``instructions`` are those of the last call."""

    def __init__(self, ecu: CortexEcu, firmware: BusFirmware) -> None:
        self._ecu = ecu
        self._kind = memory_image.dtype(firmware.module("security.secoc_state").Secoc)

    @property
    def instructions(self) -> int:
        """Instructions of the last call, if the ECU counts them."""
        return self._ecu.instructions

    def start(self, key: bytes, reset: int, listening: int) -> None:
        """Start with a key as the start number ``reset``."""
        self._ecu.write(FRAME, key)
        self._ecu.call("canroll_secoc_start", RECORD, FRAME, reset, listening)

    def resume(self, message: int, reset: int) -> None:
        """Continue with a sender."""
        self._ecu.call("canroll_secoc_resume", RECORD, message, reset)

    def elapse(self, ticks: int) -> None:
        """Count ticks."""
        self._ecu.call("canroll_secoc_elapse", RECORD, ticks)

    def verify(self, message: int, frame: bytes, length: int) -> bool:
        """Whether a received frame is to be taken."""
        self._ecu.write(FRAME, frame)
        return bool(self._ecu.call("canroll_secoc_verify", RECORD, message, FRAME, length))

    def protect(self, slot: int, frame: bytes) -> bytes:
        """Return a frame with freshness value and MAC."""
        self._ecu.write(FRAME, frame)
        self._ecu.call("canroll_secoc_protect", RECORD, slot, FRAME)
        return self._ecu.read(FRAME, SECURED)

    @property
    def refused(self) -> int:
        """Frames refused since the start."""
        return int(self._record()["refused"])

    @property
    def senders(self) -> Sequence[int]:
        """Number of the last known start of each message's sender."""
        return tuple(self._record()["rx_reset"].tolist())

    def image(self) -> bytes:
        """The bytes of the record."""
        return self._ecu.read(RECORD, self._kind.itemsize)

    def _record(self) -> Any:  # noqa: ANN401
        return np.frombuffer(self.image(), self._kind, 1)[0]
