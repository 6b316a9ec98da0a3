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
import shutil
import subprocess
import sys
import sysconfig
import tempfile
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
from canroll.errors import CanrollError
from codegen.run.bus_firmware import BusFirmware, built_in
from codegen.run.ecu_traffic import Traffic, refused
from codegen.run.memory_image import dtype, event_of
from codegen.run.service_binding import BINDINGS
from firmware.calibration import Calibration
from firmware.state import Ecu

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
DECLARATIONS = """
typedef struct {
    int32_t tick; int32_t message; int32_t length; uint8_t payload[EVENT_BYTES];
} canroll_event;
int32_t canroll_start(void *ecu, const void *cal);
void canroll_put(void *ecu, int32_t message, const uint8_t *payload, int32_t length);
void canroll_step(void *ecu, const void *cal, int32_t elapsed_ticks);
int64_t canroll_replay(
    int64_t n_ecus, uint8_t *ecus, const uint8_t *cals, int64_t ticks, const int32_t *elapsed,
    const canroll_event *rx, const int64_t *rx_end, canroll_event *tx, int64_t tx_room,
    int64_t *tx_end, uint8_t *states);
size_t canroll_ecu_size(void);
size_t canroll_calibration_size(void);
extern void *const canroll_pointers[3];
"""
BATCH = """
#include <stddef.h>
#include <string.h>
#include "canroll.h"

typedef struct {
    int32_t tick; int32_t message; int32_t length; uint8_t payload[EVENT_BYTES];
} canroll_event;

static int32_t canroll_start(void *ecu, const void *cal) { return canroll_init(ecu, cal); }
static void canroll_put(void *ecu, int32_t message, const uint8_t *payload, int32_t length)
{
    canroll_receive(ecu, message, payload, length);
}
static void canroll_step(void *ecu, const void *cal, int32_t elapsed_ticks)
{
    canroll_tick(ecu, cal, elapsed_ticks);
}
static void *const canroll_pointers[3] = {
    (void *)canroll_start, (void *)canroll_put, (void *)canroll_step
};
static size_t canroll_ecu_size(void) { return sizeof(canroll_ecu); }
static size_t canroll_calibration_size(void) { return sizeof(canroll_calibration); }

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
        assert self.lib.canroll_ecu_size() == dtype(record).itemsize
        assert self.lib.canroll_calibration_size() == dtype(Calibration).itemsize

    @property
    def pointers(self) -> dict[str, int]:
        """Addresses of init(ecu, cal) → i32, receive(ecu, message, payload, length), tick(…)."""
        found = [int(self.ffi.cast("intptr_t", p)) for p in self.lib.canroll_pointers]
        return dict(zip(("init", "receive", "tick"), found, strict=True))

    def start(self, calibrations: NDArray[np.void]) -> NDArray[np.void]:
        """Return one initialised ECU for each calibration; raise CanrollError if one is refused."""
        ecus = np.zeros(len(calibrations), dtype(self.record))
        for i in range(len(calibrations)):
            rule = self.lib.canroll_start(
                self.ffi.from_buffer(ecus[i : i + 1]), self.ffi.from_buffer(calibrations[i : i + 1])
            )
            if rule:
                raise refused(rule)
        return ecus

    def replay(
        self,
        ecus: NDArray[np.void],
        calibrations: NDArray[np.void],
        traffic: Sequence[Traffic],
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
    """Compile ``files`` (as :func:`codegen.c99.emit.emit` returns them) and load the library.

    ``record`` is the class of their state record; ``services`` are those in ``files``.
    """
    cc = compiler()
    if cc is None:
        raise CanrollError("no C compiler found: install one (cc), or choose --backend python")
    version = subprocess.run([cc, "--version"], capture_output=True, text=True, check=False)
    key = hashlib.sha256()
    binding = _binding(record, services)
    for part in (*sorted(files.items()), *binding, flags, version.stdout, sys.version):
        key.update(repr(part).encode())
    name = f"canroll_native_{key.hexdigest()[:20]}"
    path = build_cache.place("native", f"{name}{sysconfig.get_config_var('EXT_SUFFIX')}")
    if not path.exists():
        _compile([cc, *flags], files, binding, path)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Library(module, record)


def _binding(record: type, services: Sequence[str]) -> tuple[str, str]:
    """Declarations and source of the interfaces, for frames as large as ``record``'s mailboxes."""
    size = str(event_of(record)["payload"].shape[0])
    bound = [BINDINGS[name] for name in services]
    declarations = "".join([DECLARATIONS, *(its.declarations for its in bound)])
    source = "".join([BATCH, *(its.source for its in bound)])
    return declarations.replace("EVENT_BYTES", size), source.replace("EVENT_BYTES", size)


def _compile(
    command: Sequence[str], files: Mapping[str, str], binding: tuple[str, str], target: Path
) -> None:
    declarations, batch = binding
    name = target.name.partition(".")[0]
    ffi = cffi.FFI()
    ffi.cdef(declarations)
    ffi.set_source(name, batch)
    with tempfile.TemporaryDirectory(dir=target.parent) as temporary:
        folder = Path(temporary)
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
        os.replace(built, target)
