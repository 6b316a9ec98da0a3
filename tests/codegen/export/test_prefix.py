"""The prefix of a bundle: two ECUs of different bundles in one image."""

import re
import subprocess

import pytest
from support.bundles import export, make

from canroll import dbc as contract
from canroll.cli.main import main
from canroll.codegen.export import bundle, prefix
from canroll.codegen.generated import signals
from canroll.codegen.run import ecu_traffic, native
from canroll.errors import CanrollError

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")

TWO = """
#include "front.h"
#include "front_gains.h"
#include "Rear2.h"
#include "Rear2_gains.h"
static const front_calibration a = FRONT_CALIBRATION_INITIALISER;
static const Rear2_calibration b = REAR2_CALIBRATION_INITIALISER;
static front_ecu one;
static Rear2_ecu other;
int main(void)
{
    int started = front_init(&one, &a) == 0 && Rear2_init(&other, &b) == 0;
    front_tick(&one, &a, 1);
    front_tick(&one, &a, 1);
    Rear2_tick(&other, &b, 1);
    return started && one.time == 2 && other.time == 1 ? 0 : 1;
}
"""


def write(folder, name, files=(signals.DBC, signals.MAP), **options):
    traffic = ecu_traffic.random_traffic(3, 20)
    made = export(dbc=files[0], map_file=files[1], traffic=traffic, prefix=name, **options)
    bundle.write(folder, made)
    return folder


def built(*command):
    result = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=600, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.slow
def test_two_bundles_of_different_prefixes_are_one_program(tmp_path):
    front = write(tmp_path / "front", "front", services=("xcp", "uds", "nvm", "nvm_uds"))
    rear = write(tmp_path / "rear", "Rear2", specialised=True)
    (tmp_path / "main.c").write_text(TWO)
    objects = tmp_path / "objects"
    objects.mkdir()
    for folder in (front, rear):
        for source in (folder / "src").glob("*.c"):
            built("cc", "-c", "-I", folder / "include", "-o", objects / f"{source.stem}.o", source)
    symbols = built("nm", "-g", "--defined-only", *objects.glob("*.o"))
    names = re.findall(r" [A-Z] (\S+)$", symbols, re.MULTILINE)
    assert names
    assert all(name.startswith(("front_", "Rear2_")) for name in names)
    includes = ("-I", front / "include", "-I", rear / "include")
    built("cc", *includes, "-o", tmp_path / "two", tmp_path / "main.c", *objects.glob("*.o"))
    built(tmp_path / "two")


@pytest.mark.slow
@pytest.mark.parametrize("files", [None, (contract.SECURED_PATH, contract.SECURED_MAP)])
def test_all_names_have_the_prefix_and_its_own_test_passes(tmp_path, files):
    folder = write(tmp_path, "axle", *([files] if files else []))
    for path in folder.rglob("*"):
        assert "canroll" not in path.name, path
        if path.suffix in (".c", ".h", ".a2l", ".cmake", ".yml", ".conf", ".txt", ".json"):
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"canroll_|CANROLL|canroll\.(h|a2l)|canroll::", text), path
    assert "`canroll export-c DIR --elf`" in (folder / "README.md").read_text()
    result = make(folder, "test")
    assert result.returncode == 0, result.stderr
    assert bundle.description(folder).name == "axle.a2l"


@pytest.mark.slow
def test_another_prefix_in_the_same_folder_is_refused(tmp_path):
    write(tmp_path, "front")
    with pytest.raises(CanrollError, match=r"front_.*\.c: of an export with other files"):
        write(tmp_path, "rear")
    write(tmp_path, "front")


@pytest.mark.parametrize("name", ["2nd", "a-b", "", "_x", "größe", "a b", "node", "Session"])
def test_what_is_no_prefix_is_refused_in_one_line(tmp_path, capsys, name):
    assert main(["export-c", str(tmp_path), f"--prefix={name}"]) == 2
    error = capsys.readouterr().err
    assert f"--prefix {name}: " in error
    assert error.count("\n") == 1
    assert not any(tmp_path.iterdir())


def test_the_tool_and_a_stage_of_the_users_keep_their_names():
    text = "run `canroll timing` on canroll_tick of canroll.h, -DCANROLL_PUBLIC_KEY"
    files = {"README.md": text, "stage/canroll_own.py": text, "src/canroll_ecu.c": "canroll_tick"}
    assert prefix.renamed(files, "axle") == {
        "README.md": "run `canroll timing` on axle_tick of axle.h, -DAXLE_PUBLIC_KEY",
        "stage/canroll_own.py": text,
        "src/axle_ecu.c": "axle_tick",
    }
    assert prefix.renamed(files, "canroll") == files
