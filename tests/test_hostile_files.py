"""Every reader takes damaged files: a value, or one line of refusal; never a traceback."""

import io
import json
import random
import re
import shutil
import subprocess
import sys
import time
import tomllib
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from scipy.io import savemat
from support import hostile_formats as formats

from canroll import documents, vehicles
from canroll.codegen.generated import bus_map
from canroll.errors import CanrollError
from canroll.extensions.campaign import campaign_file
from canroll.extensions.exchange.fmi import map_file
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.laws.custom import read_matrices
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.traffic.log_playback import load_recording
from canroll.plant_sim.faults.language import read_file as read_faults
from canroll.runs import saved_run

TESTS = Path(__file__).parent
ROUNDS = 40
COSTLY = 4


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A folder with one good file of every format, and a saved run of two programs."""
    pytest.importorskip("pyarrow", reason="pip install 'canroll[campaign]'")
    folder = tmp_path_factory.mktemp("hostile") / "good"
    formats.make(folder)
    return folder


def name_of(form):
    return f"{form.name}{'-mended' if form.mend else ''}"


EACH = [pytest.param(f, marks=pytest.mark.slow) if f.costly else f for f in formats.FORMATS]


def damage(form, good, folder, rounds, seed=""):
    """Read a good file, and ``rounds`` damaged ones."""
    if remedy := formats.lacking(form):
        pytest.skip(remedy)
    assert formats.refusal(form, good / form.name) == ""
    source = random.Random(name_of(form) + seed)
    for n in range(rounds):
        # a name of its own: readers keep what they have read
        path = formats.damage(form, good, folder / str(n), source)
        formats.refusal(form, path)
        shutil.rmtree(path.parent)


@pytest.mark.parametrize("form", EACH, ids=name_of)
def test_a_damaged_file_is_read_or_refused(form, good, tmp_path):
    damage(form, good, tmp_path, COSTLY if form.costly else ROUNDS)


@pytest.mark.long
@pytest.mark.parametrize("form", formats.FORMATS, ids=name_of)
def test_many_damaged_files_are_read_or_refused(form, good, tmp_path):
    damage(form, good, tmp_path, 10 * (COSTLY if form.costly else ROUNDS), "long")


@pytest.mark.long
@pytest.mark.parametrize("name", ["faults/faults.toml", "bus/own.dbc"])
def test_inputs_guided_by_coverage_are_read_or_refused(name, good):
    pytest.importorskip("atheris", reason="needs atheris: pip install 'canroll[judges]'")
    command = [sys.executable, "-m", "support.fuzz_files", name, str(good), "-runs=800", "-seed=1"]
    done = subprocess.run(command, cwd=TESTS, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    seen = [int(count) for count in re.findall(r"cov: (\d+)", done.stderr)]
    assert seen[-1] > seen[0]


def leaves(tree):
    """Yield what holds each text below a document, and its key or number there."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        if isinstance(tree[key], str):
            yield tree, key
        elif isinstance(tree[key], dict | list):
            yield from leaves(tree[key])


WRITTEN = {".toml": (tomllib.loads, tomli_w.dumps), ".json": (json.loads, json.dumps)}
TREES = [form for form in formats.FORMATS if form.file[-5:] in WRITTEN]


@pytest.mark.parametrize("form", TREES, ids=name_of)
def test_a_file_that_names_code_executes_none(form, good, tmp_path, monkeypatch):
    """Whatever text in it is that of a function in a file, and whoever reads it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trap.py").write_text("open('sprung', 'w')\nthing = 1\n")
    path = tmp_path / "file" / form.file
    shutil.copytree(good / form.folder, path.parent)
    read, write = WRITTEN[path.suffix]
    content = (good / form.name).read_text(encoding="utf-8")
    for n in range(len(list(leaves(read(content))))):
        tree = read(content)
        holder, key = list(leaves(tree))[n]
        holder[key] = "trap.py:thing"
        path.write_text(write(tree), encoding="utf-8")
        if form.mend is not None:
            form.mend(path)
        formats.refusal(form, path)
        assert not (tmp_path / "sprung").exists(), key


DEEP = "a = " + "[" * 20_000
TOML_READERS = (
    map_file.read,
    vehicles.load,
    calibration_file.load,
    read_faults,
    read_matrices,
    load_traffic,
    lambda path: load_profile(str(path)),
    lambda path: bus_map.load(formats.ROOT / "examples" / "own_bus" / "own.dbc", path),
    lambda path: campaign_file.load(path, {}, runs=None, seed=None),
)


@pytest.mark.parametrize("read", TOML_READERS)
@pytest.mark.parametrize("content", [DEEP, " " * (documents.MOST_BYTES + 1)], ids=["deep", "large"])
def test_a_table_that_is_too_deep_or_too_large_is_refused(read, content, tmp_path):
    path = tmp_path / "file.toml"
    path.write_text(content)
    with pytest.raises(CanrollError, match=r"nested too deeply|larger than 16 MB"):
        read(path)


def test_a_byte_order_mark_before_a_campaign_is_ignored(good, tmp_path):
    path = tmp_path / "campaign.toml"
    text = (good / "campaign" / "fishhook.toml").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8-sig")
    assert campaign_file.load(path, {}, runs=3, seed=None).runs == 3


@pytest.mark.parametrize("entry", ["1.5", "[1]", "{ field = 1.5 }", "{ field = true }"])
def test_an_entry_of_a_map_that_is_no_field_is_refused(entry, good, tmp_path):
    folder = shutil.copytree(good / "bus", tmp_path / "bus")
    lines = (folder / "own.toml").read_text().splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith("[receive.") and n)
    signal = next(n for n in range(place, len(lines)) if ' = "' in lines[n] and "Speed" in lines[n])
    lines[signal] = f"{lines[signal].partition(' = ')[0]} = {entry}"
    (folder / "own.toml").write_text("\n".join(lines))
    with pytest.raises(CanrollError):
        bus_map.load(folder / "own.dbc", folder / "own.toml")


def test_a_saved_run_names_no_files_outside_its_folder(good, tmp_path):
    """Its hashes are those of two files; a path among them is not followed."""
    folder = shutil.copytree(good / "run", tmp_path / "run")
    result = folder / saved_run.RESULT
    data = json.loads(result.read_text())
    data[saved_run.HASHES]["/dev/zero"] = ""
    result.write_text(json.dumps(data))
    saved_run.load(folder)
    for name in saved_run.HASHED:
        result.write_text(json.dumps({**data, saved_run.HASHES: {name: ""}}))
        with pytest.raises(CanrollError):
            saved_run.load(folder)


def test_a_file_that_ends_the_reader_ends_nothing_else(tmp_path):
    """scipy 1.17 dies of a name in a .mat that is longer than it says."""
    path = tmp_path / "gains.mat"
    savemat(path, {"K": np.ones((1, 2))})
    path.write_bytes(
        path.read_bytes().replace(b"\x01\x00K\x00\x00\x00", b"\x01\x00K-inf\x00\x00\x00")
    )
    with pytest.raises(CanrollError, match=r"gains\.mat: not a \.mat file"):
        read_matrices(path)


def test_a_reader_that_crashes_ends_nothing_else(tmp_path):
    with pytest.raises(ValueError, match="the reader crashed"):
        documents.read_apart("import os; os.abort()", tmp_path)
    with pytest.raises(ValueError, match="ValueError: of its own"):
        documents.read_apart("raise ValueError('of its own')", tmp_path)


def test_a_time_that_is_no_number_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "timestamp,arbitration_id,extended,remote,error,dlc,data\ninf,0x80,0,0,0,1,AA==\n"
    )
    with pytest.raises(CanrollError, match="a time is beyond"):
        load_recording(path, bitrate=500_000)


@pytest.mark.parametrize("shape", [(200_000_000,), (1 << 20, 1 << 20), (1, 1001)])
def test_gains_are_looked_at_before_they_are_read(tmp_path, shape):
    """What an archive unpacks to is not what it takes on the disk."""
    path = tmp_path / "gains.npz"
    content = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(content, header)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("K.npy", content.getvalue() + bytes(1 << 20))
    tracemalloc.start()
    with pytest.raises(CanrollError, match=r"gains\.npz: K has more than 1000 numbers"):
        read_matrices(path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_gains_of_a_mat_file_are_looked_at_before_they_are_read(tmp_path):
    path = tmp_path / "gains.mat"
    savemat(path, {"K": np.zeros((1000, 1000))}, do_compression=True)
    with pytest.raises(CanrollError, match=r"K has more than 1000 numbers"):
        read_matrices(path)


def test_a_reader_apart_has_its_share_of_memory_and_time(tmp_path):
    with pytest.raises(ValueError, match="MemoryError"):
        documents.read_apart("bytearray(1 << 30)", tmp_path, memory=1 << 29)
    with pytest.raises(ValueError, match=r"cannot be read within 0\.5 s"):
        documents.read_apart("while True: pass", tmp_path, seconds=0.5)


@pytest.mark.parametrize("form", ["{} = 1", "[{}]", "x = {{ {} = 1 }}"])
@pytest.mark.parametrize("part", ["a", '"a"', "'a b'"])
def test_a_dotted_key_is_bounded(form, part):
    assert documents.parse_toml(form.format(" . ".join([part] * documents.MOST_PARTS)))
    with pytest.raises(ValueError, match="a dotted key of more than 32 parts"):
        documents.parse_toml(form.format(".".join([part] * 100_000)))
    before = time.process_time()
    documents.parse_toml(f'x = "{"word" * 1_000_000}"\n' + "a.b = 1\nc = 2.5\n".replace("a", "y"))
    assert time.process_time() - before < 2.0
