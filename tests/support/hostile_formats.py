"""Every format that canroll reads: one good file of each, its reader, and damage."""

import json
import random
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import can
import cantools
import numpy as np
import tomli_w
from scipy.io import savemat

from canroll import vehicles
from canroll.codegen.export import a2l
from canroll.codegen.generated import bus_map, own_stage
from canroll.codegen.run import native, stage_modules
from canroll.dbc.keys import read_key
from canroll.errors import CanrollError
from canroll.extensions.campaign import campaign_file, store
from canroll.extensions.campaign.faults import catalogue as fault_catalogue
from canroll.extensions.exchange.fmi import plant as fmu
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.laws.custom import read_matrices
from canroll.hil import plant_record, tick_trace
from canroll.hil.hardware import lasting
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.traffic.log_playback import load_recording
from canroll.plant_sim.driving import signal_file
from canroll.plant_sim.faults.language import read_file as read_faults
from canroll.runs import saved_run
from canroll.runs.experiment import plan
from canroll.runs.result import Run
from support import hostile_samples as samples

ROOT = Path(__file__).parents[2]
HARSH = (
    *(b"nan", b"inf", b"-inf", b"-1", b"1e308", b"0", b"[]", b'""', b"{}", b"true", b"9" * 20),
    *(b"\xff", b"\x00", b"\xef\xbb\xbf", b"[", b"=", b"\n", b"[[" * 2000),
)
"""What is put in the place of a number, or between two bytes."""
LOGS = ("asc", "blf", "log", "trc", "csv", "pcap", "pcapng", "db")
EXTRAS = {"chunk": ("pyarrow", "campaign"), "fmu": ("fmpy", "fmi"), "mf4": ("asammdf", "asammdf")}
"""Module and extra that the formats of a folder need."""


@dataclass(frozen=True, slots=True)
class Format:
    """One file of a folder and what reads it.

    Attributes:
        folder: folder of good files with the file and whatever belongs to it.
        file: its name there.
        read: reads it.
        mend: makes checksums over the damaged file fit again, so that more than they are tried.
        costly: reading takes about a second.
    """

    folder: str
    file: str
    read: Callable[[Path], object]
    mend: Callable[[Path], None] | None = None
    costly: bool = False

    @property
    def name(self) -> str:
        """Folder and file."""
        return f"{self.folder}/{self.file}"


def _sealed(path: Path) -> None:
    """Give a damaged calibration the digest of its content."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        schema = content.pop("schema", None)
        content.pop(calibration_file.DIGEST, None)
        head = {"schema": schema, calibration_file.DIGEST: calibration_file.digest(content)}
        path.write_text(tomli_w.dumps(head | content), encoding="utf-8")
    except (ValueError, TypeError, AttributeError, RecursionError):
        return


def _rehashed(path: Path) -> None:
    """Give a saved run the hashes of its files."""
    result = path.parent / saved_run.RESULT
    data = json.loads(result.read_text(encoding="utf-8"))
    data[saved_run.HASHES][path.name] = saved_run.digest(path)
    result.write_text(json.dumps(data), encoding="utf-8")


def _sealed_run(path: Path) -> None:
    _sealed(path)
    _rehashed(path)


def lacking(form: Format) -> str:
    """Return how to install what a format's good file or its reader needs, "" if it is there."""
    if form.folder == "elf":
        return "" if native.compiler() else "apt-get install gcc"
    module, extra = EXTRAS.get(form.folder, ("canroll", ""))
    return "" if find_spec(module) else f"pip install 'canroll[{extra}]'"


def _log(path: Path) -> object:
    return load_recording(path, bitrate=500_000)


def _signal(path: Path) -> object:
    return signal_file.read(str(path), ["steering_wheel_deg"])


def _measurement(path: Path) -> object:
    return signal_file.read(str(path), ["steering"])


def _bus(path: Path) -> object:
    return bus_map.load(path.parent / "own.dbc", path.parent / "own.toml")


def _profile(path: Path) -> object:
    return load_profile(str(path))


def _campaign(path: Path) -> object:
    return campaign_file.load(path, {}, runs=None, seed=None)


def _chunk(path: Path) -> object:
    return store.Chunks(path.parent, "digest").read(path.stem)


def _latency(path: Path) -> object:
    return load_profile(str(path.with_name("segments.toml")))


def _stage(path: Path) -> object:
    return stage_modules.modules(own_stage.read(path))


def _catalogue(path: Path) -> object:
    return fault_catalogue.entries(_settings(), path)


@cache
def _settings() -> Run:
    return plan("double_lane_change")[0]


def _plan(path: Path) -> object:
    return store.opened(path.parent, "digest", {}, resume=True)


def _fmu(path: Path) -> object:
    return fmu.read(str(path.with_name("van.fmu")))


def _run(path: Path) -> object:
    return saved_run.load(path.parent)


FORMATS = (
    Format("vehicle", "vehicle.toml", vehicles.load),
    Format("calibration", "calibration.toml", calibration_file.load),
    Format("calibration", "calibration.toml", calibration_file.load, mend=_sealed),
    Format("faults", "faults.toml", read_faults),
    Format("campaign", "fishhook.toml", _campaign),
    Format("chunk", "0000000.parquet", _chunk),
    Format("chunk", store.PLAN, _plan),
    Format("catalogue", "catalogue.toml", _catalogue),
    Format("bus", "own.dbc", _bus),
    Format("bus", "own.toml", _bus),
    Format("network", "network.toml", _profile),
    Format("network", "segments.toml", _profile),
    Format("network", "others.dbc", _profile),
    Format("network", "others.kcd", _profile),
    Format("network", "others.sym", _profile),
    Format("network", "others.arxml", _profile),
    Format("network", "traffic.toml", load_traffic),
    Format("network", "gateway.csv", _latency),
    Format("secured", "bus.key", read_key),
    Format("secured", "memory.json", lasting.read),
    Format("gains", "gains.toml", read_matrices),
    Format("gains", "gains.npz", read_matrices),
    Format("gains", "gains.mat", read_matrices, costly=True),
    Format("signal", "signal.csv", _signal),
    Format("stage", "stage.py", _stage, costly=True),
    Format("fmu", "van.fmu", _fmu),
    Format("fmu", "van.toml", _fmu),
    Format("elf", "firmware.elf", a2l.addresses),
    *(Format("log", f"log.{suffix}", _log) for suffix in LOGS),
    Format("mf4", "log.mf4", _log, costly=True),
    Format("mf4", "measurement.mf4", _measurement, costly=True),
    Format("run", "ticks.npz", tick_trace.load),
    Format("run", "plant.npz", plant_record.load),
    Format("run", saved_run.RESULT, _run),
    Format("run", saved_run.TRACE, _run, mend=_rehashed),
    Format("run", saved_run.CALIBRATION, _run, mend=_sealed_run),
)
"""The formats; one stands twice where checksums would hide what lies behind them."""


def make(folder: Path) -> None:
    """Write one good file of every format, with what belongs to it, into folders of ``folder``."""
    make_undriven(folder)
    _drive(folder / "run")
    (folder / "calibration").mkdir()
    shutil.copy(folder / "run" / saved_run.CALIBRATION, folder / "calibration")


def make_undriven(folder: Path) -> None:
    """Write those good files that are not of a run of two programs, which takes a while."""
    for name in {each.folder for each in FORMATS} - {"run", "calibration"}:
        (folder / name).mkdir(parents=True)
    shutil.copy(ROOT / "vehicles" / "van_real.toml", folder / "vehicle" / "vehicle.toml")
    shutil.copy(ROOT / "examples" / "campaigns" / "fishhook.toml", folder / "campaign")
    shutil.copy(ROOT / "examples" / "own_stage" / "progressive.py", folder / "stage" / "stage.py")
    for file in (ROOT / "examples" / "own_bus").iterdir():
        shutil.copy(file, folder / "bus")
    for name, text in samples.TEXTS.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "secured" / "bus.key").chmod(0o600)
    with zipfile.ZipFile(folder / "fmu" / "van.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", samples.DESCRIPTION)
    if compiler := native.compiler():
        image = ["-xc", "-", "-c", "-o", str(folder / "elf" / "firmware.elf")]
        symbols = b"int calibration, ecu; const char canroll_epk[4];"
        subprocess.run([compiler, *image], input=symbols, check=True)
    database = cantools.database.load_file(ROOT / "dbc" / "roll_control.dbc")
    for suffix in ("dbc", "kcd", "sym"):
        cantools.database.dump_file(database, folder / "network" / f"others.{suffix}")
    np.savez(folder / "gains" / "gains.npz", K=np.ones((1, 2)), Kff=np.ones(1))
    savemat(folder / "gains" / "gains.mat", {"K": np.ones((1, 2))})
    for name in [*(f"log/log.{suffix}" for suffix in LOGS), "mf4/log.mf4"]:
        if name.endswith("mf4") and not find_spec("asammdf"):
            continue
        with can.Logger(folder / name) as log:
            for n in range(50):
                log(can.Message(1e-3 * n, 0x80 + n % 3, is_extended_id=False, data=bytes(n % 9)))
    if find_spec("asammdf"):
        asammdf = import_module("asammdf")
        with asammdf.MDF(version="4.10") as file:
            file.append(asammdf.Signal(np.arange(50.0), np.arange(50.0), "deg", "steering"))
            file.save(folder / "mf4" / "measurement.mf4")
    pa = store.arrow()
    table = pa.table({"draw": [0, 1], "verdict": ["good", "bad"]}).replace_schema_metadata(
        {store.DIGEST: b"digest"}
    )
    pa.parquet.write_table(table, folder / "chunk" / "0000000.parquet")


def _drive(folder: Path) -> None:
    """Save a run of two programs, without what is for people."""
    command = [sys.executable, "-m", "canroll.cli.main", "hil", "double_lane_change"]
    options = ["--pace", "lockstep", "--law", "lqr", "--duration", "0.3", "--out", str(folder)]
    subprocess.run([*command, *options], check=True, capture_output=True, cwd=ROOT)
    read = {form.file for form in FORMATS if form.folder == "run"}
    for path in folder.iterdir():
        if path.name not in read:
            path.unlink()


def damaged(content: bytes, source: random.Random) -> bytes:
    """Return ``content`` with one to four places changed as ``source`` draws."""
    found = bytearray(content)
    for _ in range(source.randint(1, 4)):
        place = source.randrange(len(found) or 1)
        other = source.randrange(len(found) or 1)
        kind = source.randrange(7)
        if kind == 0:
            found[place : place + 1] = bytes([source.randrange(256)])
        elif kind == 1:
            del found[place : place + source.randint(1, 40)]
        elif kind == 2:
            found[place:place] = source.choice(HARSH)
        elif kind == 3:
            del found[place:]
        elif kind == 4:
            found[place : place + 8] = found[other : other + 8]
        else:
            words = rb"-?\d+\.?\d*" if kind == 5 else rb'"[^"\n]*"|\btrue\b|\bfalse\b'
            spans = [m.span() for m in re.finditer(words, bytes(found))]
            if spans:
                begin, end = source.choice(spans)
                found[begin:end] = source.choice(HARSH)
    return bytes(found)


def damage(form: Format, good: Path, work: Path, source: random.Random) -> Path:
    """Copy the folder of a format to ``work`` with its file damaged; return the file's path."""
    return placed(form, good, work, damaged((good / form.name).read_bytes(), source))


def placed(form: Format, good: Path, work: Path, content: bytes) -> Path:
    """Copy the folder of a format to ``work`` with other content of its file; return its path."""
    shutil.copytree(good / form.folder, work)
    path = work / form.file
    path.write_bytes(content)
    if form.mend is not None:
        form.mend(path)
    return path


def refusal(form: Format, path: Path) -> str:
    """Return the line with which a file is refused, or "".

    Raises:
        Exception: whatever else the reader raises, and AssertionError for a refusal of more lines.
    """
    try:
        form.read(path)
    except CanrollError as error:
        line = str(error)
        assert line.strip(), "a refusal without a word"
        assert "\n" not in line.strip(), line
        return line
    return ""
