"""The bundle for a network that several files describe: that of one file, and all the files."""

import json
from dataclasses import replace

import pytest
from support import split_bus
from support.bundles import compared, export

from canroll.codegen.export import bundle
from canroll.codegen.run import native
from canroll.errors import CanrollError

NAMED = ("README.md", "test/codec.json")
"""Files that name the descriptions, besides comments in the sources."""


def of_files(files):
    return export(dbc=files, map_file=split_bus.MAP)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundles")
    files = split_bus.write(folder)
    bundle.write(folder / "both", of_files(files))
    bundle.write(folder / "one", of_files(split_bus.OWN))
    return folder / "both", folder / "one", files


def texts(folder):
    return {
        str(path.relative_to(folder)): path.read_text(encoding="utf-8")
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".dbc"
    }


@pytest.mark.slow
def test_its_sources_and_vectors_are_those_of_one_file(folders):
    both, one, _ = folders
    found, expected = texts(both), texts(one)
    assert found.keys() == expected.keys()
    changed = {
        name
        for name in found
        if found[name].replace("car.dbc and actuators.dbc", "own.dbc") != expected[name]
    }
    # the software's name is made of its sources, comments included
    assert changed - {"canroll.a2l", "include/canroll_epk.h"} == set(NAMED)


@pytest.mark.slow
def test_it_has_all_files(folders):
    both, _, files = folders
    for path in files:
        assert (both / path.name).read_bytes() == path.read_bytes()
    assert "`car.dbc`, `actuators.dbc`" in (both / "README.md").read_text(encoding="utf-8")
    about = json.loads((both / "test" / "codec.json").read_text(encoding="utf-8"))
    assert about["databases"] == ["car.dbc", "actuators.dbc"]


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_its_codec_agrees_with_cantools(folders):
    both, _, _ = folders
    done = compared(both, 200)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS") == 7


def test_two_files_of_one_name_are_refused(folders, tmp_path):
    car, actuators = folders[2]
    other = tmp_path / "car.dbc"
    other.write_bytes(actuators.read_bytes())
    wanted = replace(of_files((car, actuators)), dbc=(car, other))
    with pytest.raises(CanrollError, match=r"car\.dbc is the name of several network descriptions"):
        bundle.write(tmp_path / "bundle", wanted)
    assert not (tmp_path / "bundle").exists()
