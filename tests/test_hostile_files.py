"""Every reader takes damaged files: a value, or one line of refusal; never a traceback."""

import json
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import can
import numpy as np
import pytest
from scipy.io import savemat

import vehicles
from canroll import apart
from canroll.errors import CanrollError
from codegen.generated import bus_map
from gain_gen.calibration import calibration_file
from gain_gen.laws.custom import read_matrices
from hil.realtime import plant_record, tick_trace
from hil.runs import saved_run
from plant_sim.can_bus import load_profile
from plant_sim.can_bus.traffic.files import load_traffic
from plant_sim.can_bus.traffic.log_playback import load_recording

ROOT = Path(__file__).parents[1]
OWN_BUS = ROOT / "examples" / "own_bus"
HARSH = (
    b"nan",
    b"inf",
    b"-1",
    b"1e308",
    b"0",
    b"[]",
    b'""',
    b"9" * 20,
    b"\xff",
    b"\x00",
    b"[",
    b"=",
)
"""What stands in the place of a number, or between two bytes."""
ROUNDS = 40
NETWORK = "schema = 1\nbitrate = 500000\nload = 0.3\ngateway_ms = [2, 4]\n"
TRAFFIC = '[[message]]\nname = "A"\nid = 16\nbytes = 8\nperiod_ms = 10\njitter_ms = 1\n'


def damaged(content, source):
    """Return ``content`` with one to four places changed, as ``source`` (random.Random) draws."""
    found = bytearray(content)
    for _ in range(source.randint(1, 4)):
        place = source.randrange(len(found) or 1)
        other = source.randrange(len(found) or 1)
        kind = source.randrange(6)
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
            numbers = [m.span() for m in re.finditer(rb"-?\d+\.?\d*", bytes(found))]
            if numbers:
                begin, end = source.choice(numbers)
                found[begin:end] = source.choice(HARSH)
    return bytes(found)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with one good file of every format, and a saved run of two programs."""
    folder = tmp_path_factory.mktemp("good")
    command = [sys.executable, "-m", "hil.cli.main", "hil", "double_lane_change"]
    options = [
        "--pace",
        "lockstep",
        "--law",
        "lqr",
        "--duration",
        "0.1",
        "--out",
        str(folder / "run"),
    ]
    subprocess.run([*command, *options], check=True, capture_output=True, cwd=ROOT)
    shutil.copy(Path(vehicles.__file__).with_name("van_real.toml"), folder / "vehicle.toml")
    (folder / "network.toml").write_text(NETWORK)
    (folder / "traffic.toml").write_text(TRAFFIC)
    (folder / "gains.toml").write_text("K = [[14400.0, 6000.0]]\nKff = 120.0\n")
    np.savez(folder / "gains.npz", K=np.ones((1, 2)), Kff=np.ones(1))
    savemat(folder / "gains.mat", {"K": np.ones((1, 2))})
    for suffix in ("asc", "blf", "log", "trc", "csv", "pcap"):
        with can.Logger(folder / f"log.{suffix}") as log:
            for n in range(50):
                log(can.Message(1e-3 * n, 0x80 + n % 3, is_extended_id=False, data=bytes(n % 9)))
    return folder


def refuses_in_one_line(read, *arguments):
    try:
        read(*arguments)
    except CanrollError as error:
        assert "\n" not in str(error).strip()


@pytest.mark.parametrize(
    ("name", "read", "rounds"),
    [
        ("vehicle.toml", vehicles.load, ROUNDS),
        ("run/calibration.toml", calibration_file.load, ROUNDS),
        ("run/ticks.npz", tick_trace.load, ROUNDS),
        ("run/plant.npz", plant_record.load, ROUNDS),
        ("network.toml", lambda path: load_profile(str(path)), ROUNDS),
        ("traffic.toml", load_traffic, ROUNDS),
        ("gains.toml", read_matrices, ROUNDS),
        ("gains.npz", read_matrices, ROUNDS),
        ("gains.mat", read_matrices, 5),
        *(
            (f"log.{suffix}", lambda path: load_recording(path, bitrate=500_000), ROUNDS)
            for suffix in ("asc", "blf", "log", "trc", "csv", "pcap")
        ),
    ],
)
def test_a_damaged_file_is_read_or_refused(name, read, rounds, files, tmp_path):
    good = files / name
    content = good.read_bytes()
    read(good)
    source = random.Random(name)
    for n in range(rounds):
        path = tmp_path / f"{n}{good.suffix}"
        path.write_bytes(damaged(content, source))
        refuses_in_one_line(read, path)


@pytest.mark.parametrize("name", ["own.dbc", "own.toml"])
def test_a_damaged_dbc_or_map_is_read_or_refused(name, tmp_path):
    source = random.Random(name)
    for n in range(ROUNDS):
        folder = Path(shutil.copytree(OWN_BUS, tmp_path / str(n)))
        (folder / name).write_bytes(damaged((OWN_BUS / name).read_bytes(), source))
        refuses_in_one_line(bus_map.load, folder / "own.dbc", folder / "own.toml")


@pytest.mark.parametrize("name", ["result.json", "trace.npz", "calibration.toml"])
def test_a_damaged_run_with_fitting_hashes_is_read_or_refused(name, files, tmp_path):
    source = random.Random(name)
    for n in range(ROUNDS // 4):
        folder = Path(shutil.copytree(files / "run", tmp_path / str(n)))
        (folder / name).write_bytes(damaged((folder / name).read_bytes(), source))
        if name != saved_run.RESULT:
            data = json.loads((folder / saved_run.RESULT).read_text())
            data[saved_run.HASHES][name] = saved_run.digest(folder / name)
            (folder / saved_run.RESULT).write_text(json.dumps(data))
        refuses_in_one_line(saved_run.load, folder)


def test_a_file_that_ends_the_reader_ends_nothing_else(tmp_path):
    """scipy 1.17 dies of a name in a .mat that is longer than it says."""
    path = tmp_path / "gains.mat"
    savemat(path, {"K": np.ones((1, 2))})
    path.write_bytes(
        path.read_bytes().replace(b"\x01\x00K\x00\x00\x00", b"\x01\x00K-inf\x00\x00\x00")
    )
    with pytest.raises(CanrollError, match=r"gains\.mat: not a \.mat file"):
        read_matrices(path)


def test_a_damaged_mf4_is_read_or_refused(tmp_path):
    """Its reader is compiled too, and runs in a process of its own."""
    pytest.importorskip("asammdf", reason="pip install 'canroll[asammdf]'")
    good = tmp_path / "good.mf4"
    with can.Logger(good) as log:
        for n in range(50):
            log(can.Message(1e-3 * n, 0x80 + n % 3, is_extended_id=False, data=bytes(n % 9)))
    assert len(load_recording(good, bitrate=500_000).frames.t_ns) == 50
    content = good.read_bytes()
    source = random.Random("mf4")
    for n in range(4):
        path = tmp_path / f"{n}.mf4"
        path.write_bytes(damaged(content, source))
        refuses_in_one_line(lambda path: load_recording(path, bitrate=500_000), path)


def test_a_reader_that_crashes_ends_nothing_else(tmp_path):
    with pytest.raises(ValueError, match="the reader crashed"):
        apart.arrays("import os; os.abort()", tmp_path)
    with pytest.raises(ValueError, match="ValueError: of its own"):
        apart.arrays("raise ValueError('of its own')", tmp_path)


def test_a_time_that_is_no_number_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "timestamp,arbitration_id,extended,remote,error,dlc,data\ninf,0x80,0,0,0,1,AA==\n"
    )
    with pytest.raises(CanrollError, match="a time is beyond"):
        load_recording(path, bitrate=500_000)
