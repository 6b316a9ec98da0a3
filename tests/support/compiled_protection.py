"""The protection of a bus in C, called frame by frame, without the loop around it."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

from codegen.run import memory_image, native
from codegen.run.bus_firmware import BusFirmware
from firmware.calibration import Calibration

FLAGS = ("-std=c99", "-O0", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined")
NEVER_TRAP = ("-fno-sanitize-recover=undefined", "-shared", "-fPIC")


class CompiledProtection:
    """``protect`` and ``check`` of a firmware, under the sanitizer of undefined behaviour."""

    def __init__(self, firmware: BusFirmware, folder: Path) -> None:
        """Compile them in a folder."""
        files = firmware.files
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        compiled = [name for name in files if name.endswith(".c")]
        library = folder / "protection.so"
        cc = native.compiler()
        assert cc is not None and shutil.which(cc)
        subprocess.run(
            [cc, *FLAGS, *NEVER_TRAP, "-o", str(library), *(str(folder / n) for n in compiled)],
            check=True,
        )
        self._library = ctypes.CDLL(str(library))
        self._record = firmware.record
        self._calibration = np.frombuffer(memory_image.image(Calibration()), np.uint8).copy()

    def protect(self, ecu: object, slot: int) -> None:
        """Finish the frame in a slot of a record."""
        image = self._image(ecu)
        self._library.canroll_protection_protect(_at(image), slot)
        memory_image.fill(ecu, image.tobytes())

    def check(self, ecu: object, calibration: Calibration, message: int, slot: int) -> int:
        """Judge the frame in a slot of a record."""
        image = self._image(ecu)
        self._calibration[:] = np.frombuffer(memory_image.image(calibration), np.uint8)
        judged = self._library.canroll_protection_check(
            _at(image), _at(self._calibration), message, slot
        )
        memory_image.fill(ecu, image.tobytes())
        return int(judged)

    def _image(self, ecu: object) -> np.ndarray:
        return np.frombuffer(memory_image.image(ecu), np.uint8).copy()


def _at(image: np.ndarray) -> ctypes.c_void_p:
    return image.ctypes.data_as(ctypes.c_void_p)
