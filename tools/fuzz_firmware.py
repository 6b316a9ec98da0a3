"""Fuzzing of the firmware's ``receive`` and ``tick`` as C under AddressSanitizer and UBSan.

    python -m tools.fuzz_firmware [--inputs N] [--seed S] [--dbc DBC … --map MAP] [--keep FOLDER]

The driver (fuzz_firmware.c) runs the loop, with XCP and UDS beside it where the bus has them, on
random calibrations that ``check`` accepts and on designs of the generator, with frames of driven
manoeuvres and random ones. Inputs are mutated from those that executed something new. Any crash,
undefined behaviour or field outside its declared range ends it with exit code 1; the file ``crash``
in the folder then repeats it.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from canroll.codegen.generated.mailbox import Mailbox
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import BusFirmware, built_in, of_bus, with_services
from canroll.dbc.reader import Files, paths_of
from canroll.errors import CanrollError
from canroll.extensions.services.running import uds_frames, xcp_frames
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields
from tools.recorded_traffic import CASES, Recording, record

FLAGS = (
    *("-std=c99", "-g", "-O1", "-fno-omit-frame-pointer", "-no-pie", "-w"),
    *("-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
)
TRACED = "-fsanitize-coverage=trace-pc"
ENVIRONMENT = {"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}
RANDOM = 48
VARIANTS = 64
COUNTERS = 16
"""Contents of each frame, recorded ones and random ones, and values of its counter."""
DRIVEN = 3.0
"""Seconds of the recorded manoeuvres."""
RECORDED = tuple(CASES[k] for k in (0, 2, 3, 8, 10, 15))


def firmware_of(dbc: Files | None, map_file: Path | None) -> BusFirmware:
    """Return the firmware of a bus with the services that its map has identifiers for."""
    firmware = of_bus(dbc, map_file) if dbc and map_file else built_in()
    has = {"xcp": firmware.bus.xcp, "uds": firmware.bus.uds}
    return with_services(firmware, tuple(name for name, its in has.items() if its is not None))


def recorded_bodies(recordings: Sequence[Recording], message: int) -> list[list[int]]:
    """Return contents of a mailbox's frame while the manoeuvres are at their height."""
    found: list[list[int]] = []
    for each in recordings:
        frames = each.traffic.frames
        frames = frames[frames["message"] == message]["payload"]
        share = VARIANTS // len(recordings)
        found += frames[len(frames) // 2 :][:share].tolist()
    return found


def _bytes(data: bytes) -> str:
    return "{" + ",".join(map(str, data)) + "}"


def _pool(message: int, box: Mailbox, recordings: Sequence[Recording]) -> tuple[str, str]:
    """Correct frames of a mailbox with every value of its counter, as C and its description."""
    if not box.name:
        return "", "{ 0, 1, 1, 1 }"
    rng = np.random.default_rng(message)
    counter = box.protection.counter if box.protection else None
    counters = min(counter.values if counter else 1, COUNTERS)
    bodies = recorded_bodies(recordings, message)
    bodies += rng.integers(0, 256, (VARIANTS // 2, box.length)).tolist()
    bodies += rng.choice([0x00, 0x01, 0x7F, 0x80, 0xFE, 0xFF], (VARIANTS // 2, box.length)).tolist()
    frames = b"".join(
        bytes(ecu_traffic.finished(box, body, value, box.length))
        for body in bodies
        for value in range(counters)
    )
    text = f"static const uint8_t POOL_{message}[] = {_bytes(frames)};\n"
    return text, f"{{ POOL_{message}, {len(bodies)}, {counters}, {box.length} }}"


def material(
    firmware: BusFirmware, calibrations: Sequence[Calibration], recordings: Sequence[Recording]
) -> str:
    """Return what the driver needs as a C header."""
    places: Mapping[str, Any] = memory_image.dtype(firmware.record).fields or {}
    ranges = [
        f'    {{ "{f.name}", {places[f.name][1]}, {1 if f.kind == "u8" else 4}, '
        f"{int(np.prod(f.shape, dtype=int))}, {f.f.lo if f.f.lo > -(2**31) else 'INT32_MIN'}, "
        f"{f.f.hi} }},\n"
        for f in fields(firmware.record)
    ]
    images = [f"    {_bytes(memory_image.image(record))},\n" for record in calibrations]
    pools = [_pool(k, box, recordings) for k, box in enumerate(firmware.bus.received)]
    heard = ", ".join(map(str, sorted(firmware.heard)))
    services = []
    if "xcp" in firmware.services:
        services.append(f"#define HAS_XCP\n#define XCP_HEARS {xcp_frames(firmware)[0]}u\n")
    if "uds" in firmware.services:
        services.append(f"#define HAS_UDS\n#define UDS_HEARS {uds_frames(firmware)[0]}u\n")
    size = memory_image.dtype(Calibration).itemsize
    return "".join(
        [
            *services,
            "static const struct { const char *name; int32_t offset, size, count, low, high; }\n",
            "RANGES[] = {\n",
            *ranges,
            "};\n",
            f"enum {{ N_CALIBRATIONS = {len(images)} }};\n",
            f"static const uint8_t CALIBRATIONS[][{size}] = {{\n",
            *images,
            "};\n",
            "struct pool { const uint8_t *bytes; uint32_t variants, counters; int32_t length; };\n",
            *(text for text, _ in pools),
            f"static const struct pool POOLS[] = {{ {', '.join(row for _, row in pools)} }};\n",
            f"static const uint32_t HEARD[] = {{ {heard} }};\n",
        ]
    )


def build(
    firmware: BusFirmware,
    calibrations: Sequence[Calibration],
    folder: Path,
    recordings: Sequence[Recording] = (),
) -> Path:
    """Compile driver and firmware with the sanitizers; return the program in ``folder``.

    Raises:
        CanrollError: no gcc, or it fails.
    """
    cc = native.compiler()
    if cc is None:
        raise CanrollError("fuzzing needs a C compiler: apt-get install gcc libc6-dev")
    for name, text in firmware.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    header = material(firmware, calibrations, recordings)
    (folder / "material.h").write_text(header, encoding="utf-8")
    sources = sorted(str(path) for path in folder.glob("*.c"))
    objects = [f"{path}.o" for path in sources]
    driver = str(Path(__file__).with_suffix(".c"))
    program = folder / "fuzz"
    command = [cc, *FLAGS, "-I", str(folder)]
    steps = [
        [*command, TRACED, "-c", source, "-o", compiled]
        for source, compiled in zip(sources, objects, strict=True)
    ]
    steps.append([*command, "-o", str(program), driver, *objects])
    for step in steps:
        done = subprocess.run(step, capture_output=True, text=True, check=False)
        if done.returncode:
            first = next((s for s in done.stderr.splitlines() if "error" in s), done.stderr)
            raise CanrollError(f"{cc} cannot build the fuzzer: {first.strip()}")
    return program


def fuzz(program: Path, inputs: int, seed: int) -> subprocess.CompletedProcess[str]:
    """Run ``inputs`` inputs; what ended it is in the file ``crash`` beside the program."""
    command = [str(program), str(inputs), str(seed), str(program.with_name("crash"))]
    return subprocess.run(
        command, stdout=subprocess.PIPE, stderr=None, text=True, check=False, env=ENVIRONMENT
    )


def main() -> int:
    """Fuzz for a number of inputs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--dbc", type=Path, action="append")
    parser.add_argument("--map", type=Path)
    parser.add_argument("--keep", type=Path, help="folder of the program and of a crash")
    options = parser.parse_args()
    try:
        firmware = firmware_of(options.dbc and paths_of(options.dbc), options.map)
        driven = [record(case, DRIVEN) for case in RECORDED]
        calibrations = [each.calibration for each in driven]
        calibrations += map(ecu_traffic.random_calibration, range(RANDOM))
        with tempfile.TemporaryDirectory() as temporary:
            folder = options.keep or Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            program = build(firmware, calibrations, folder, () if options.dbc else driven)
            services = ", ".join(firmware.services) or "none"
            print(f"{len(calibrations)} calibrations; services: {services}", flush=True)
            done = fuzz(program, options.inputs, options.seed)
            print(done.stdout, end="")
            return int(done.returncode != 0)
    except CanrollError as error:
        print(f"fuzz: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
