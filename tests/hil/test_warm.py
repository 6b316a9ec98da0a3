"""Nothing is compiled once a program says that it is ready, whatever the cache was like."""

import os
import re
import shutil
import signal

import pytest

from canroll import build_cache
from canroll.codegen.run import native
from canroll.hil import plant_record, tick_trace, warm
from canroll.plant_sim.kernels import jit


def test_compilations_are_counted():
    def fresh(x):
        return x + 1

    with warm.counted_compilations() as compiled:
        assert jit.njit(fresh)(1) == 2
    assert compiled.count > 0
    seen = compiled.count
    jit.njit(fresh)(2)
    assert compiled.count == seen


@pytest.mark.slow
@pytest.mark.parametrize(
    "cache",
    ["full", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("none", "of another CPU"))],
)
def test_nothing_is_compiled_in_the_loops(cache, programs, calibration_file, tmp_path, monkeypatch):
    home = tmp_path / "home"
    if cache == "none":
        # a file where the folder would be: nothing can be kept
        home.write_text("")
    elif cache == "of another CPU":
        shutil.copytree(jit.FOLDER, home / "canroll" / jit.FOLDER.name)
        monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
        monkeypatch.setenv("NUMBA_CPU_FEATURES", "")
    if cache != "full":
        monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    record, trace = tmp_path / "plant.npz", tmp_path / "ticks.npz"
    stay = ("--peer-timeout", 0)
    arguments = ("--serve", "127.0.0.1:0", "--wait", 0, "--duration", 3600, "--record", record)
    vehicle = programs("plant", "plant", "double_lane_change", *arguments, *stay)
    vehicle.wait_for("plant runs")
    bus = re.search(r"serving (.*)", vehicle.said)[1].split(" ")
    options = ("--calibration", calibration_file, "--duration", 1.0, "--trace", trace)
    ecu = programs("ecu", "ecu", *bus, *options, *stay)
    assert ecu.end() == 0, ecu.said
    vehicle.process.send_signal(signal.SIGTERM)
    assert vehicle.end() == 0, vehicle.said
    assert tick_trace.load(trace).about["compilations"] == 0
    assert len(tick_trace.load(trace).ticks) > 0
    seen = plant_record.load(record)
    assert seen.about["compilations"] == 0
    assert 0x300 in seen.frames["ident"]


def test_a_cache_that_cannot_be_written_is_read(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = build_cache.folder("native")
    assert build_cache.built("native", "there", of_text("kept")) == kept / "there"
    monkeypatch.setattr(os, "access", lambda path, mode: not str(path).startswith(str(tmp_path)))
    assert build_cache.built("native", "there", of_text("anew")) == kept / "there"
    elsewhere = build_cache.built("native", "missing", of_text("anew"))
    assert elsewhere.parent == build_cache.private("native") and elsewhere.read_text() == "anew"


def of_text(text):
    """Return what makes a file with a text in a folder."""

    def make(folder):
        (folder / "made").write_text(text)
        return folder / "made"

    return make


@pytest.mark.parametrize("open_to_all", ["canroll", "canroll/native"])
def test_a_cache_that_anyone_may_write_to_is_not_used(tmp_path, monkeypatch, open_to_all):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = build_cache.folder("native")
    assert kept == tmp_path / "canroll" / "native"
    (tmp_path / open_to_all).chmod(0o777)
    assert build_cache.folder("native") == build_cache.private("native")


def test_a_cache_of_another_user_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    build_cache.folder("native")
    owner = (tmp_path / "canroll").stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert owner == 0 or build_cache.folder("native") == build_cache.private("native")
    os.chown(tmp_path / "canroll", owner + 2, -1) if owner == 0 else None
    assert build_cache.folder("native") == build_cache.private("native")


def test_without_a_cache_the_firmware_is_built_all_the_same(tmp_path, monkeypatch):
    if native.compiler() is None:
        pytest.skip("needs a C compiler: apt-get install gcc")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert build_cache.folder("native") == build_cache.private("native")
    target = build_cache.built("native", "x.so", of_text("code"))
    assert target.parent == build_cache.private("native")
    assert target.parent.stat().st_mode & 0o077 == 0
