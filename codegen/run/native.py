"""The emitted C99 as a native library: cc and cffi, cached by a hash of its inputs.

Two interfaces: single calls (``init``, ``receive``, ``tick``) and :meth:`Library.replay`, which
runs any number of ticks and ECUs in one call. ``pointers`` are the addresses of the C functions,
for compiled callers.
"""

import contextlib
import hashlib
import importlib.util
import io
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from canroll import build_cache
from canroll.codegen.c99 import record_name
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.ecu_traffic import EcuTraffic, refused
from canroll.codegen.run.machine import c_name
from canroll.codegen.run.memory_image import dtype, event_of, fill, image
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
DECLARATIONS = """
typedef struct { ...; } canroll_calibration;
typedef struct { ...; } canroll_ecu;
int32_t canroll_init(void *ecu, const void *cal);
void canroll_receive(void *ecu, int32_t message, const uint8_t payload[], int32_t length);
void canroll_tick(void *ecu, const void *cal, int32_t elapsed_ticks);
typedef struct {
    int32_t tick; int32_t message; int32_t length; uint8_t payload[EVENT_BYTES];
} canroll_event;
int64_t canroll_replay(
    int64_t n_ecus, uint8_t *ecus, const uint8_t *cals, int64_t ticks, const int32_t *elapsed,
    const canroll_event *rx, const int64_t *rx_end, canroll_event *tx, int64_t tx_room,
    int64_t *tx_end, uint8_t *states);
extern void *const canroll_pointers[3];
"""
BATCH = """
#include <stddef.h>
#include <string.h>
#include "canroll.h"

typedef struct {
    int32_t tick; int32_t message; int32_t length; uint8_t payload[EVENT_BYTES];
} canroll_event;

static void *const canroll_pointers[3] = {
    (void *)canroll_init, (void *)canroll_receive, (void *)canroll_tick
};

static int64_t canroll_replay(
    int64_t n_ecus, uint8_t *ecus, const uint8_t *cals, int64_t ticks, const int32_t *elapsed,
    const canroll_event *rx, const int64_t *rx_end, canroll_event *tx, int64_t tx_room,
    int64_t *tx_end, uint8_t *states)
{
    int64_t taken = 0, sent = 0;
    for (int64_t e = 0; e < n_ecus; e++) {
        canroll_ecu *ecu = (canroll_ecu *)(void *)(ecus + (size_t)e * sizeof(canroll_ecu));
        const canroll_calibration *cal =
            (const canroll_calibration *)(const void *)(cals
            + (size_t)e * sizeof(canroll_calibration));
        for (int64_t t = 0; t < ticks; t++) {
            for (; taken < rx_end[e] && rx[taken].tick <= t; taken++) {
                canroll_receive(ecu, rx[taken].message, rx[taken].payload, rx[taken].length);
            }
            canroll_tick(ecu, cal, elapsed[t]);
            for (int32_t slot = 0; slot < CANROLL_N_TX; slot++) {
                if (ecu->tx_pending[slot] == 1) {
                    ecu->tx_pending[slot] = 0;
                    if (sent < tx_room) {
                        tx[sent].tick = (int32_t)t;
                        tx[sent].message = slot;
                        tx[sent].length = canroll_signals_tx_lengths[slot];
                        memcpy(tx[sent].payload, ecu->tx_payload[slot],
                            sizeof ecu->tx_payload[slot]);
                    }
                    sent++;
                }
            }
            if (states != NULL) {
                memcpy(states, ecu, sizeof(canroll_ecu));
                states += sizeof(canroll_ecu);
            }
        }
        taken = rx_end[e];
        tx_end[e] = sent;
    }
    return sent;
}
"""


@dataclass(frozen=True, slots=True)
class Replay:
    """Results of ECUs: frames sent in order, end of each ECU's frames, states after each tick."""

    frames: NDArray[np.void]
    ends: NDArray[np.int64]
    states: NDArray[np.void] | None


class Library:
    """The firmware compiled for this machine."""

    def __init__(self, module: ModuleType, record: type = Ecu) -> None:
        self.ffi: Any = module.ffi
        self.lib: Any = module.lib
        self.record = record
        self.check_size(record)
        self.check_size(Calibration)

    def check_size(self, record: type) -> None:
        """Assert that a record has the same size in C."""
        assert self.ffi.sizeof(record_name(record.__name__)) == dtype(record).itemsize

    @property
    def pointers(self) -> dict[str, int]:
        """Addresses of init(ecu, cal) → i32, receive(ecu, message, payload, length), tick(…)."""
        found = [int(self.ffi.cast("intptr_t", p)) for p in self.lib.canroll_pointers]
        return dict(zip(("init", "receive", "tick"), found, strict=True))

    def start(self, calibrations: NDArray[np.void]) -> NDArray[np.void]:
        """Return one initialised ECU for each calibration; raise CanrollError if one is refused."""
        ecus = np.zeros(len(calibrations), dtype(self.record))
        for i in range(len(calibrations)):
            rule = self.lib.canroll_init(
                self.ffi.from_buffer(ecus[i : i + 1]), self.ffi.from_buffer(calibrations[i : i + 1])
            )
            if rule:
                raise refused(rule)
        return ecus

    def replay(
        self,
        ecus: NDArray[np.void],
        calibrations: NDArray[np.void],
        traffic: Sequence[EcuTraffic],
        *,
        states: bool = False,
    ) -> Replay:
        """Run each ECU through its traffic, all of equal length, in one call.

        ``ecus`` are changed in place. With ``states`` the record after each tick is kept, shape
        (ECUs, ticks).
        """
        ticks = traffic[0].ticks
        rx = np.concatenate([each.frames for each in traffic])
        rx_end = np.cumsum([len(each.frames) for each in traffic]).astype(np.int64)
        room = 4 * ticks * len(ecus)
        tx = np.zeros(room, event_of(self.record))
        tx_end = np.zeros(len(ecus), np.int64)
        kept = np.zeros((len(ecus), ticks), dtype(self.record)) if states else None
        buffer = self.ffi.from_buffer
        sent = self.lib.canroll_replay(
            len(ecus),
            buffer("uint8_t *", ecus, require_writable=True),
            buffer("uint8_t *", calibrations),
            ticks,
            buffer("int32_t *", np.ascontiguousarray(traffic[0].elapsed, np.int32)),
            buffer("canroll_event *", rx),
            buffer("int64_t *", rx_end),
            buffer("canroll_event *", tx, require_writable=True),
            room,
            buffer("int64_t *", tx_end, require_writable=True),
            self.ffi.NULL if kept is None else buffer("uint8_t *", kept, require_writable=True),
        )
        return Replay(tx[:sent], tx_end, kept)


class NativeRecord:
    """A record in the memory of this process, as C lays it out: one row of :attr:`array`."""

    def __init__(self, value: Any, library: Library) -> None:  # noqa: ANN401
        self._kind: type = value.__class__
        library.check_size(self._kind)
        # not copied as an array: that leaves out the padding
        self.array = np.frombuffer(bytearray(image(value)), dtype(self._kind), 1)
        self.buffer = library.ffi.from_buffer("uint8_t[]", self.array, require_writable=True)

    def __getitem__(self, field: str) -> Any:  # noqa: ANN401
        """Return the value of a field, an array as a view."""
        return self.array[field][0]

    def __setitem__(self, field: str, value: Any) -> None:  # noqa: ANN401
        """Set a field."""
        self.array[field] = value

    def image(self) -> bytes:
        """The bytes of the record."""
        return self.array.tobytes()

    def fill(self, data: bytes) -> None:
        """Set the record from its bytes."""
        self.array[:] = np.frombuffer(data, self.array.dtype, 1)

    @property
    def value(self) -> Any:  # noqa: ANN401
        """A copy of the record."""
        copy = self._kind()
        fill(copy, self.image())
        return copy


class NativeMachine:
    """This computer running the compiled firmware."""

    def __init__(self, firmware: BusFirmware) -> None:
        self.library = library_of(firmware)
        self._functions: dict[str, Any] = {}

    def record(self, value: Any) -> NativeRecord:  # noqa: ANN401
        """Put a record in the memory of this process."""
        return NativeRecord(value, self.library)

    def call(self, function: str, *arguments: Any) -> int:  # noqa: ANN401
        """Call a function; see :meth:`canroll.codegen.run.machine.Machine.call`."""
        run = self._functions.get(function)
        if run is None:
            run = self._functions[function] = getattr(self.library.lib, c_name(function))
        passed = [each.buffer if isinstance(each, NativeRecord) else each for each in arguments]
        for place, each in enumerate(arguments):
            if isinstance(each, bytearray):
                passed[place] = self.library.ffi.from_buffer(each)
        return run(*passed) or 0


def compiler() -> str | None:
    """The C compiler: ``$CC``, cc, gcc or clang; None if there is none."""
    names = (os.environ.get("CC"), "cc", "gcc", "clang")
    return next((path for name in names if name and (path := shutil.which(name))), None)


def library() -> Library:
    """The firmware of this package as a library; see :func:`library_of`."""
    return library_of(built_in())


@cache
def library_of(firmware: BusFirmware) -> Library:
    """The firmware for a bus as a library, from the cache if present.

    Raises CanrollError if there is no compiler or it fails.
    """
    return build(firmware.files, record=firmware.record, services=firmware.services)


def build(
    files: Mapping[str, str],
    flags: Sequence[str] = FLAGS,
    *,
    record: type = Ecu,
    services: Sequence[str] = (),
) -> Library:
    """Compile ``files`` (of :func:`canroll.codegen.c99.emit.emit`) and load the library.

    ``record`` is the class of their state record; ``services`` are those in ``files``.
    """
    cc = compiler()
    if cc is None:
        raise CanrollError("no C compiler found: install one (cc), or choose --backend python")
    version = subprocess.run([cc, "--version"], capture_output=True, text=True, check=False)
    key = hashlib.sha256()
    binding = _binding(record, files, services)
    for part in (*sorted(files.items()), *binding, flags, version.stdout, sys.version):
        key.update(repr(part).encode())
    name = f"canroll_native_{key.hexdigest()[:20]}"
    path = build_cache.built(
        "native",
        f"{name}{sysconfig.get_config_var('EXT_SUFFIX')}",
        lambda folder: _compiled([cc, *flags], files, binding, name, folder),
    )
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Library(module, record)


def _binding(record: type, files: Mapping[str, str], services: Sequence[str]) -> tuple[str, str]:
    """Declarations and source of the interfaces, for frames as large as ``record``'s mailboxes."""
    size = str(event_of(record)["payload"].shape[0])
    declarations = "".join([DECLARATIONS, *(_declared(files, name) for name in services)])
    return declarations.replace("EVENT_BYTES", size), BATCH.replace("EVENT_BYTES", size)


def _declared(files: Mapping[str, str], service: str) -> str:
    """The functions of a service and its record, as cffi reads them: on records without a type."""
    state = files.get(f"canroll_{service}_state.h", "")
    records = re.findall(rf"^}} (canroll_{service});", state, re.MULTILINE)
    prototypes = re.findall(
        rf"^(?:void|u?int\d+_t) canroll_{service}_\w+\([^;{{]*\);",
        files[f"canroll_{service}.h"],
        re.MULTILINE,
    )
    functions = [re.sub(r"\bcanroll_\w+ \*", "void *", text) for text in prototypes]
    return "\n".join([*(f"typedef struct {{ ...; }} {name};" for name in records), *functions, ""])


def _compiled(
    command: Sequence[str],
    files: Mapping[str, str],
    binding: tuple[str, str],
    name: str,
    folder: Path,
) -> Path:
    """Compile the module ``name`` of ``files`` and the interfaces in ``folder``; return it."""
    declarations, batch = binding
    ffi = cffi.FFI()
    ffi.cdef(declarations)
    ffi.set_source(name, batch)
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()):
        ffi.emit_c_code(str(folder / "binding.c"))
    sources = sorted(str(path) for path in folder.glob("*.c"))
    include = sysconfig.get_path("include")
    built = folder / "library.so"
    full = [*command, f"-I{include}", "-o", str(built), *sources]
    result = subprocess.run(full, capture_output=True, text=True, check=False, timeout=300)
    if result.returncode:
        first = next((s for s in result.stderr.splitlines() if "error" in s), result.stderr)
        raise CanrollError(f"{command[0]} cannot build the firmware: {first.strip()}")
    return built
