"""The protection of a bus in C, called frame by frame, without the loop around it."""

import ctypes
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from canroll.codegen.run import memory_image, native
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.firmware.calibration import Calibration

FLAGS = ("-std=c99", "-O0", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined")
NEVER_TRAP = ("-fno-sanitize-recover=undefined", "-shared", "-fPIC")


class CompiledProtection:
    """``protect`` and ``check`` of a firmware, under the sanitizer of undefined behaviour."""

    def __init__(self, firmware: BusFirmware, folder: Path) -> None:
        """Compile them in a folder."""
        files = firmware.files
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        compiled = _used_by("canroll_protection.c", files)
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


def _used_by(source: str, files: Mapping[str, str]) -> list[str]:
    """A source and those whose headers it includes, directly or not."""
    used = [source]
    for name in used:
        stems = re.findall(r'^#include "(\w+)\.h"', files[name], re.MULTILINE)
        headers = [f"{stem}.{kind}" for stem in stems for kind in "ch"]
        used += [header for header in headers if header in files and header not in used]
    return [name for name in used if name.endswith(".c")]


def _at(image: np.ndarray) -> ctypes.c_void_p:
    return image.ctypes.data_as(ctypes.c_void_p)
