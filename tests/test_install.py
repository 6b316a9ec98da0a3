"""A release: its contents; the wheel works without the checkout, and names a missing extra."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

from canroll.codegen.run import cortex
from tools.floors import LINKED

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
INSTALLED = ["canroll", *(f"canroll.{package}" for package in LINKED)]
OURS = ("canroll", "__editable__", "_virtualenv", "distutils-precedence")
LICENCES = {"LICENSE", "canroll/report/assets/uplot/LICENSE", "examples/bmw_m8/LICENSE"}
EXTRAS = ("asammdf", "unicorn", "ziglang")
"""Packages that come with an extra only, left out of the new environment."""


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    """Return source archive and, made from it, wheel: without a network, without traces in it."""
    pytest.importorskip("build")
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    ignored = shutil.ignore_patterns("__pycache__")
    for package in ("canroll", *LINKED):
        shutil.copytree(ROOT / package, source / package, symlinks=True, ignore=ignored)
    for path in ROOT.iterdir():
        if path.is_file() and not path.name.startswith("."):
            shutil.copy(path, source)
    for licence in LICENCES:
        (source / licence).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / licence, source / licence)
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(source)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(out.glob("canroll-*.tar.gz")), next(out.glob("canroll-*.whl"))


@pytest.fixture(scope="module")
def wheel(release):
    return release[1]


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Return the program ``canroll`` of an environment with the wheel and what it depends on."""
    root = tmp_path_factory.mktemp("environment")
    venv = [sys.executable, "-m", "venv", "--without-pip", str(root / "env")]
    subprocess.run(venv, check=True)
    python = root / "env" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "-q", "--no-deps"]
    subprocess.run([*pip, "--no-index", "--disable-pip-version-check", str(wheel)], check=True)
    # a path entry on links to this environment's packages: their own path entries don't count
    (root / "dependencies").mkdir()
    for package in Path(sysconfig.get_path("purelib")).iterdir():
        if not package.name.startswith((*OURS, *EXTRAS)) and package.suffix != ".pth":
            (root / "dependencies" / package.name).symlink_to(package)
    site = next((root / "env" / "lib").glob("python3*/site-packages"))
    (site / "dependencies.pth").write_text(f"{root / 'dependencies'}\n")
    return root / "env" / "bin" / "canroll"


@pytest.fixture(scope="module")
def canroll(installed, tmp_path_factory):
    """Return a function that runs ``canroll`` in one empty folder: exit code and what it said."""
    folder = tmp_path_factory.mktemp("empty")
    hidden = ("PYTHONPATH", "VIRTUAL_ENV")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}

    def run(*arguments):
        done = subprocess.run(
            [installed, *arguments],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout + done.stderr

    run.folder, run.python = folder, installed.with_name("python")
    code, text = run("design", "--law", "lqr", "--out", "own")
    assert code == 0, text
    return run


def test_the_wheel_holds_every_file_of_the_packages_and_no_tools(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    tracked = {
        path.relative_to(ROOT).as_posix()
        for package in INSTALLED
        for path in (ROOT / package.replace(".", "/")).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert names == tracked


def test_the_source_archive_builds_the_same_files_and_says_how_to_cite(release):
    archive, wheel = release
    with tarfile.open(archive) as packed, zipfile.ZipFile(wheel) as installed:
        names = {name.partition("/")[2] for name in packed.getnames()}
        files = {name for name in installed.namelist() if ".dist-info/" not in name}
    assert files <= names
    assert {"CHANGELOG.md", "CITATION.cff", "SECURITY.md", *LICENCES} <= names
    assert not any(name.startswith("tests/") for name in names)


def test_the_metadata_name_every_licence(release):
    pytest.importorskip("twine")
    check = [sys.executable, "-m", "twine", "check", "--strict", *map(str, release)]
    done = subprocess.run(check, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with zipfile.ZipFile(release[1]) as archive:
        (place,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = message_from_bytes(archive.read(place))
    assert metadata["License-Expression"] == "MIT AND BSD-2-Clause"
    assert set(metadata.get_all("License-File")) == LICENCES


def test_nothing_comes_from_the_checkout(canroll):
    program = (
        f"import {', '.join(INSTALLED)}; print({', '.join(f'{p}.__file__' for p in INSTALLED)})"
    )
    done = subprocess.run(
        [canroll.python, "-c", program],
        cwd=canroll.folder,
        capture_output=True,
        text=True,
        check=True,
    )
    prefix = str(canroll.python.parents[1])
    assert all(path.startswith(prefix) for path in done.stdout.split())


def test_a_law_with_the_names_of_0_2_hears_the_new_ones(canroll):
    (canroll.folder / "old.py").write_text("from gain_gen.laws import declared\n")
    code, text = canroll("design", "--law", "old.py:law")
    assert code == 2 and text.endswith("No module named 'gain_gen': it is canroll.gain_gen\n")


CALIBRATION = ("--calibration", "own/calibration.toml")


@pytest.mark.parametrize(
    ("arguments", "made"),
    [
        (
            ("run", "double_lane_change", *CALIBRATION, "--duration", "2", "--out", "out"),
            "out/report.html",
        ),
        (("export-c", "bundle", *CALIBRATION), "bundle/Makefile"),
        (("margins", "own/calibration.toml"), "own/canroll_gains.h"),
        (("prove", "own/calibration.toml"), None),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_command_works(canroll, arguments, made):
    code, text = canroll(*arguments)
    assert code == 0, text
    assert made is None or (canroll.folder / made).stat().st_size > 0


@pytest.mark.skipif(
    not cortex.has_gcc_and_qemu(), reason="needs gcc-arm-none-eabi, qemu-system-arm"
)
def test_timing_needs_no_extra_where_qemu_is(canroll):
    code, text = canroll("timing", *CALIBRATION, "--duration", "0.5")
    assert code == 0, text
    assert "qemu" in text


@pytest.mark.parametrize(
    ("arguments", "packages", "extra"),
    [
        (
            ("timing", *CALIBRATION, "--counter", "unicorn"),
            "bincopy, capstone, unicorn and ziglang",
            "target",
        ),
        (("run", "double_lane_change", "--signals", "x.mf4"), "asammdf", "asammdf"),
        (("run", "double_lane_change", "--log", "x.mf4"), "asammdf", "asammdf"),
    ],
)
def test_a_missing_extra_is_named(canroll, arguments, packages, extra):
    code, text = canroll(*arguments)
    assert code == 2
    assert f"needs {packages}: pip install 'canroll[{extra}]'\n" in text
    assert text.count("\n") == 1
