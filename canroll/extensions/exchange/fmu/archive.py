"""An FMU as a file: compiled for this machine, with its sources, the same bytes every time."""

import hashlib
import platform
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from canroll.codegen.run.native import compiler
from canroll.errors import CanrollError, reason
from canroll.extensions.exchange.fmu import description
from canroll.extensions.exchange.fmu.variables import Interface, table

SOURCES = Path(__file__).with_name("sources")
SHELL = ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h", "fmu.h", "fmu.c")
OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden")
"""``-ffp-contract=off``: no operation on floats is fused, so that every machine rounds alike."""
TOKEN = "FMU_TOKEN"
WITHOUT_PORTS = {"FMU_PORTS": 0, "FMU_BUFFER": 1}
_EPOCH = (1980, 1, 1, 0, 0, 0)


def shell(*names: str) -> dict[str, str]:
    """Texts of fmu.c with its headers, and of further files of ``sources``."""
    return {
        name: (SOURCES / name).read_text(encoding="utf-8")
        for name in dict.fromkeys((*SHELL, *names))
    }


def model(of: str, include: str, values: Mapping[str, int], text: str) -> str:
    """Text of model.h: constants, the record ``model`` that ``text`` defines, and what is more.

    Args:
        of: whose FMU it is.
        include: header of what is in the record.
        values: constants, ``FMU_PORTS`` and ``FMU_BUFFER`` among them.
        text: C.
    """
    defined = "".join(f"#define {name} {value}\n" for name, value in values.items())
    return (
        f"/* The state of the {of}'s FMU. */\n#ifndef MODEL_H\n#define MODEL_H\n\n"
        f'#include "{include}"\n\n#define {TOKEN}\n{defined}\n{text}\n#endif\n'
    )


def write(path: Path, interface: Interface, sources: Mapping[str, str]) -> None:
    """Compile an FMU and write it to ``path``.

    Args:
        path: the file, replaced if it exists.
        interface: what importers see.
        sources: C files and headers by name, model.h among them; the table of variables, fmu.c and
            its headers are added.

    Raises:
        CanrollError: no C compiler, or the file cannot be written.
    """
    files = {**shell(), **sources, "variables.c": table(interface)}
    files["model.h"] = files["model.h"].replace(TOKEN, f'{TOKEN} "{_token(interface, files)}"', 1)
    options = " ".join(OPTIONS)
    texts = {
        "modelDescription.xml": description.model_description(interface, _named(files["model.h"])),
        "sources/buildDescription.xml": description.build_description(
            interface.identifier, files, options
        ),
    }
    if interface.terminals:
        texts["terminalsAndIcons/terminalsAndIcons.xml"] = description.terminals(interface)
        texts[f"extra/{description.LS_BUS}/fmi-ls-manifest.xml"] = description.manifest(interface)
    texts |= {f"sources/{name}": text for name, text in files.items()}
    binary = build(interface.identifier, files)
    place = f"binaries/{machine()}/{interface.identifier}.so"
    try:
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in sorted(texts.items()):
                _add(archive, name, text.encode())
            _add(archive, place, binary)
    except OSError as error:
        raise CanrollError(f"cannot write {path}: {reason(error)}: choose another file") from error


def machine() -> str:
    """This machine as FMI 3.0 names it, as x86_64-linux."""
    known = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
    kind = platform.machine().lower()
    return f"{known.get(kind, kind)}-{'linux' if sys.platform == 'linux' else 'darwin'}"


def build(identifier: str, files: Mapping[str, str]) -> bytes:
    """Compile the sources to a shared library."""
    cc = compiler()
    if cc is None:
        raise CanrollError("no C compiler found: an FMU needs one (cc)")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = sorted(name for name in files if name.endswith(".c"))
        built = f"{identifier}.so"
        command = [cc, *OPTIONS, "-fPIC", "-shared", "-s", "-o", built, *sources, "-lm"]
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if result.returncode:
            first = next((s for s in result.stderr.splitlines() if "error" in s), result.stderr)
            raise CanrollError(f"{cc} cannot build the FMU: {first.strip()}")
        return (folder / built).read_bytes()


def _token(interface: Interface, files: Mapping[str, str]) -> str:
    """What names this FMU and no other: a hash of all that it is made of."""
    digest = hashlib.sha256(version("canroll").encode())
    for name, text in sorted(files.items()):
        digest.update(f"{name}\n{text}\n".encode())
    digest.update(description.model_description(interface, "").encode())
    return f"{{{digest.hexdigest()[:32]}}}"


def _named(header: str) -> str:
    """The token in model.h."""
    return header.partition(f'{TOKEN} "')[2].partition('"')[0]


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    entry = zipfile.ZipInfo(name, _EPOCH)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, data)
