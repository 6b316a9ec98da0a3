"""Every format that canroll reads: one good file of each, its reader, and damage."""

import json
import random
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import can
import cantools
import numpy as np
import tomli_w
from scipy.io import savemat

import vehicles
from canroll.errors import CanrollError
from codegen.generated import bus_map, own_stage
from gain_gen.calibration import calibration_file
from gain_gen.laws.custom import read_matrices
from hil.campaign import campaign_file, store
from hil.realtime import plant_record, tick_trace
from hil.runs import saved_run
from plant_sim.can_bus import load_profile
from plant_sim.can_bus.traffic.files import load_traffic
from plant_sim.can_bus.traffic.log_playback import load_recording
from plant_sim.driving.steer_maneuvers import read_signal
from plant_sim.faults.language import read_file as read_faults

ROOT = Path(__file__).parents[2]
HARSH = (
    *(b"nan", b"inf", b"-inf", b"-1", b"1e308", b"0", b"[]", b'""', b"{}", b"true", b"9" * 20),
    *(b"\xff", b"\x00", b"\xef\xbb\xbf", b"[", b"=", b"\n", b"[[" * 2000),
)
"""What is put in the place of a number, or between two bytes."""
NETWORK = "schema = 1\nbitrate = 500000\nload = 0.3\ngateway_ms = [2, 4]\n"
SEGMENTS = """schema = 1

[segment.chassis]
bitrate = 500000
load = 0.4

[segment.body]
bitrate = 500000
traffic = "traffic.toml"

[[gateway]]
segments = ["chassis", "body"]
latency_ms = [1, 2]

[node.RollControl]
segment = "body"
jitter_ms = 0.1
"""
TRAFFIC = '[[message]]\nname = "A"\nid = 16\nbytes = 8\nperiod_ms = 10\njitter_ms = 1\n'
FAULTS = """[[fault]]
where = "Imu.RollRate"
kind = "offset"
value = 0.2
start = 2.0
"""
LOGS = ("asc", "blf", "log", "trc", "csv", "pcap", "pcapng")


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


def _log(path: Path) -> object:
    return load_recording(path, bitrate=500_000)


def _bus(path: Path) -> object:
    return bus_map.load(path.parent / "own.dbc", path.parent / "own.toml")


def _profile(path: Path) -> object:
    return load_profile(str(path))


def _campaign(path: Path) -> object:
    return campaign_file.load(path, {}, runs=None, seed=None)


def _chunk(path: Path) -> object:
    return store.Store(path.parent, "digest").read(path.stem)


def _run(path: Path) -> object:
    return saved_run.load(path.parent)


FORMATS = (
    Format("vehicle", "vehicle.toml", vehicles.load),
    Format("calibration", "calibration.toml", calibration_file.load),
    Format("calibration", "calibration.toml", calibration_file.load, mend=_sealed),
    Format("faults", "faults.toml", read_faults),
    Format("campaign", "fishhook.toml", _campaign),
    Format("chunk", "0000000.parquet", _chunk),
    Format("bus", "own.dbc", _bus),
    Format("bus", "own.toml", _bus),
    Format("network", "network.toml", _profile),
    Format("network", "segments.toml", _profile),
    Format("network", "others.dbc", _profile),
    Format("network", "others.kcd", _profile),
    Format("network", "others.sym", _profile),
    Format("network", "traffic.toml", load_traffic),
    Format("gains", "gains.toml", read_matrices),
    Format("gains", "gains.npz", read_matrices),
    Format("gains", "gains.mat", read_matrices, costly=True),
    Format("signal", "signal.csv", read_signal),
    Format("stage", "stage.py", own_stage.read),
    *(Format("log", f"log.{suffix}", _log) for suffix in LOGS),
    Format("mf4", "log.mf4", _log, costly=True),
    Format("run", "ticks.npz", tick_trace.load),
    Format("run", "plant.npz", plant_record.load),
    Format("run", saved_run.RESULT, _run),
    Format("run", saved_run.TRACE, _run, mend=_rehashed),
    Format("run", saved_run.CALIBRATION, _run, mend=_sealed_run),
)
"""The formats; one stands twice where checksums would hide what lies behind them."""


def make(folder: Path) -> None:
    """Write one good file of every format, with what belongs to it, into folders of ``folder``."""
    for name in {each.folder for each in FORMATS} - {"run"}:
        (folder / name).mkdir(parents=True)
    _drive(folder / "run")
    shutil.copy(folder / "run" / saved_run.CALIBRATION, folder / "calibration")
    shutil.copy(ROOT / "vehicles" / "van_real.toml", folder / "vehicle" / "vehicle.toml")
    shutil.copy(ROOT / "examples" / "campaigns" / "fishhook.toml", folder / "campaign")
    for file in (ROOT / "examples" / "own_bus").iterdir():
        shutil.copy(file, folder / "bus")
    texts = {
        "network/network.toml": NETWORK,
        "network/segments.toml": SEGMENTS,
        "network/traffic.toml": TRAFFIC,
        "gains/gains.toml": "K = [[14400.0, 6000.0]]\nKff = 120.0\n",
        "faults/faults.toml": FAULTS,
        "signal/signal.csv": "time,steering_wheel_deg\n0,0\n1,10\n2.5,-10\n",
        "stage/stage.py": "STATE = {}\n\n\ndef estimate(ecu, cal, steps):\n    return\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
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
    pa = store.arrow()
    table = pa.table({"draw": [0, 1], "verdict": ["good", "bad"]}).replace_schema_metadata(
        {store.DIGEST: b"digest"}
    )
    pa.parquet.write_table(table, folder / "chunk" / "0000000.parquet")


def _drive(folder: Path) -> None:
    command = [sys.executable, "-m", "hil.cli.main", "hil", "double_lane_change"]
    options = ["--pace", "lockstep", "--law", "lqr", "--duration", "0.1", "--out", str(folder)]
    subprocess.run([*command, *options], check=True, capture_output=True, cwd=ROOT)


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
    shutil.copytree(good / form.folder, work)
    path = work / form.file
    path.write_bytes(damaged(path.read_bytes(), source))
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
