"""The bundle of specialised code builds, passes the general code's vectors, takes nothing else."""

import shutil

import pytest
from support import split_bus
from support.bundles import export, make

from canroll import dbc as contract
from canroll.cli import main
from canroll.codegen.export import a2l, bundle, misra
from canroll.codegen.export.header import gains_header
from canroll.codegen.run import cortex, ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import of_bus
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
]
STRICT = "-std=c99 -O1 -Wall -Wextra -Wconversion -Wsign-conversion -Wshadow -Wpedantic -Werror"
SANITIZED = "-std=c99 -O1 -g -fsanitize=undefined,address -fno-sanitize-recover=all"
OWN = {"dbc": split_bus.OWN, "map_file": split_bus.MAP}
SECURED = {"dbc": contract.SECURED_PATH, "map_file": contract.SECURED_MAP}


def special(record, **paths):
    bus = of_bus(paths["dbc"], paths["map_file"]).bus if paths else None
    traffic = ecu_traffic.random_traffic(3, 150, hostile=0.3, bus=bus)
    return export(record, traffic=traffic, specialised=True, **paths)


@pytest.fixture(scope="module")
def record():
    return ecu_traffic.random_calibration(7)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, record):
    path = tmp_path_factory.mktemp("specialised")
    bundle.write(path, special(record))
    return path


@pytest.mark.parametrize("flags", [STRICT, SANITIZED], ids=["strict", "sanitized"])
def test_the_vectors_of_the_general_code_pass(folder, flags, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    result = make(copy, "test", f"CFLAGS={flags}")
    assert result.returncode == 0, result.stderr
    assert "PASS: 150 ticks" in result.stdout


@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_they_pass_on_a_bare_cortex_m(folder):
    result = make(folder, "run", "example.elf")
    assert result.returncode == 0, result.stderr
    assert "PASS" in result.stdout


@pytest.mark.long
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_cppcheck_and_misra_find_only_what_is_documented(folder):
    found = misra.cppcheck(folder / "src", folder / "include")
    assert {rule: where for rule, where in found.items() if rule not in misra.DEVIATIONS} == {}


def test_the_header_of_another_calibration_does_not_compile(folder, record, tmp_path):
    other = Calibration()
    memory_image.fill(other, memory_image.image(record))
    other.force_max[0] ^= 1
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    header = gains_header(memory_image.sealed(other), title=["other"])
    (copy / "include" / "canroll_gains.h").write_text(header)
    result = make(copy, "test")
    assert result.returncode != 0
    assert "is not the calibration that the code was specialised for" in result.stderr


def test_a_changed_record_with_the_old_crc_does_not_start(folder, record, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    path = copy / "include" / "canroll_gains.h"
    text = path.read_text()
    line = next(i for i, row in enumerate(text.splitlines()) if "/* moment_max" in row) + 1
    rows = text.splitlines()
    assert str(record.moment_max) in rows[line]
    rows[line] = rows[line].replace(str(record.moment_max), str(record.moment_max ^ 2))
    path.write_text("\n".join(rows) + "\n")
    result = make(copy, "test")
    assert result.returncode != 0
    assert "FAIL: vectors, step 0: init: " in result.stdout


def test_nothing_can_be_tuned(folder):
    text = (folder / "canroll.a2l").read_text()
    assert "MEASUREMENT ecu.moment" in text
    assert "CHARACTERISTIC" not in text and "MEMORY_SEGMENT" not in text
    assert 'SYSTEM_CONSTANT "CALIBRATION_CRC"' in text
    pytest.importorskip("pya2l", reason="needs pya2l")


def test_the_readme_says_so(folder):
    text = (folder / "README.md").read_text()
    assert "specialised for the one calibration" in text
    assert "There\nis nothing to tune" in text.replace("nothing\nto", "nothing to")
    assert "--address" not in text
    assert "{" not in text.replace("{ ", "")


def test_a_programmer_gets_no_calibration_for_it(folder, tmp_path, capsys):
    elf = tmp_path / "any.elf"
    elf.write_bytes(b"")
    arguments = ["export-c", str(folder), "--elf", str(elf), "--calibration", "any.toml"]
    assert main.main(arguments) == 2
    assert "specialised for one calibration" in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--elf", "x.elf"], ["--address", "0x1000"]])
def test_what_specialised_code_cannot_have_is_refused(tmp_path, capsys, option):
    assert main.main(["export-c", str(tmp_path / "out"), "--specialise", *option]) == 2
    assert "--specialise has the calibration compiled in" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_it_is_not_mixed_with_general_code(folder, record, tmp_path):
    with pytest.raises(CanrollError, match=r"canroll_specialised\.c: of an export"):
        bundle.write(folder, export(record))
    general = tmp_path / "general"
    bundle.write(general, export(record))
    with pytest.raises(CanrollError, match="of an export with other files"):
        bundle.write(general, special(record))


@pytest.mark.long
def test_a_users_own_bus(tmp_path, record):
    own = Calibration()
    memory_image.fill(own, memory_image.image(record))
    own.e2e = 0
    memory_image.sealed(own)
    out = tmp_path / "out"
    bundle.write(out, special(own, **OWN))
    result = make(out, "test")
    assert result.returncode == 0, result.stderr + result.stdout


@pytest.fixture(scope="module")
def secured(tmp_path_factory, record):
    path = tmp_path_factory.mktemp("secured")
    bundle.write(path, special(record, **SECURED))
    return path


@pytest.mark.parametrize(
    "flags", [STRICT, pytest.param(SANITIZED, marks=pytest.mark.long)], ids=["strict", "sanitized"]
)
def test_a_bus_with_authenticated_frames(secured, flags, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(secured, copy)
    result = make(copy, "test", f"CFLAGS={flags}")
    assert result.returncode == 0, result.stderr
    assert "PASS: 150 ticks" in result.stdout
    assert "PASS: SecOC, 24 frames sent and 18 judged, byte for byte" in result.stdout
    assert "canroll_secoc_verify(&secoc" in (secured / "board" / "node.c").read_text()


@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_a_bare_cortex_m_with_authenticated_frames(secured):
    result = make(secured, "run", "example.elf", "DEFINES=-DCANROLL_PUBLIC_KEY")
    assert result.returncode == 0, result.stderr
    assert "warning" not in result.stderr
    assert "PASS" in result.stdout


@pytest.mark.long
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_cppcheck_and_misra_with_authenticated_frames(secured):
    key = secured / "src" / "canroll_key.c"
    key.write_text(key.read_text().replace("#ifndef CANROLL_PUBLIC_KEY", "#if 0"))
    found = misra.cppcheck(secured / "src", secured / "include")
    assert {rule: where for rule, where in found.items() if rule not in misra.DEVIATIONS} == {}


def test_addresses_of_an_image_go_into_its_a2l(folder):
    text = a2l.located((folder / "canroll.a2l").read_text(), {"ecu": 0x20000000})
    assert "ECU_ADDRESS 0x20000000" in text
