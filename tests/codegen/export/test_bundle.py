"""The exported bundle builds and passes with cc alone, on a bare Cortex-M, and for a user's bus."""

import re
import shutil
import subprocess
import sys
from importlib.metadata import version

import cantools
import pytest

from canroll.errors import CanrollError
from codegen.export import a2l, bundle, flash, interrupts
from codegen.export.header import gains_header
from codegen.generated import signals
from codegen.run import cortex, ecu_traffic, memory_image, native
from hil.cli import export_c

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")

MAP = """schema = 1
[receive.imu]
message = "Inertial"
signals.Rate = "roll_rate"
signals.Lateral = "lateral_acceleration"
[receive.actuator_state]
message = "Actuators"
signals.Front = "delivered[0]"
signals.Rear = "delivered[1]"
[transmit.suspension_force]
message = "Forces"
signals.Left = "force[0]"
signals.Right = "force[1]"
"""
DBC = """VERSION ""
NS_ :
BS_:
BU_: Ecu Car
BO_ 291 Inertial: 5 Car
 SG_ Rate : 7|16@0- (0.01,0) [-327|327] "deg/s" Ecu
 SG_ Lateral : 23|12@0+ (0.02,-40) [-40|40] "m/s2" Ecu
BO_ 292 Actuators: 4 Car
 SG_ Front : 0|16@1- (1,0) [-32767|32766] "Nm" Ecu
 SG_ Rear : 16|16@1- (1,0) [-32767|32766] "Nm" Ecu
BO_ 293 Forces: 4 Ecu
 SG_ Left : 7|16@0- (0.5,0) [-4000|4000] "N" Car
 SG_ Right : 23|16@0- (0.5,0) [-4000|4000] "N" Car
"""


def export(record, traffic, dbc=signals.DBC, map_file=signals.MAP):
    return bundle.Export(
        record=record,
        gains=gains_header(record, title=["sample"]),
        title="A sample.",
        dbc=dbc,
        map_file=map_file,
        traffic=traffic,
        origin="Random vectors.",
    )


def make(folder, *goals):
    return subprocess.run(
        ["make", "-C", str(folder), *goals],
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bundle")
    bundle.write(
        path, export(ecu_traffic.random_calibration(3), ecu_traffic.random_traffic(3, 100))
    )
    return path


def test_make_test_passes_with_a_compiler_alone(folder):
    result = make(folder, "test", "CFLAGS=-std=c99 -O1 -Wall -Wextra -Wpedantic -Werror")
    assert result.returncode == 0, result.stderr
    assert "PASS: 100 ticks" in result.stdout


def test_a_changed_gain_is_noticed(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "changed")
    source = tmp_path / "changed" / "src" / "canroll_observer.c"
    text = source.read_text()
    assert text.count("canroll_scaled(acc, cal->phi_shift[i])") == 1
    source.write_text(
        text.replace(
            "canroll_scaled(acc, cal->phi_shift[i])", "canroll_sat31(acc >> cal->phi_shift[i])"
        )
    )
    result = make(tmp_path / "changed", "test")
    assert result.returncode != 0
    assert "FAIL: tick" in result.stdout


@pytest.mark.parametrize("name", ["Makefile", "CMakeLists.txt"])
def test_it_is_built_with_the_flags_that_the_figures_are_of(folder, name):
    assert " ".join(cortex.OPTIMISATION) in (folder / name).read_text()


@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_the_same_vectors_pass_on_a_bare_cortex_m(folder):
    result = make(folder, "run", "example.elf")
    assert result.returncode == 0, result.stderr
    assert "PASS" in result.stdout
    base = a2l.addresses(folder / "firmware.elf")
    assert base["ecu"] >= 0x20000000 > base["calibration"]


def runs(*commands):
    for command in commands:
        result = subprocess.run(
            [str(part) for part in command],
            capture_output=True,
            text=True,
            timeout=1800,
            check=False,
        )
        assert result.returncode == 0, result.stderr + result.stdout
    return result.stdout


needs_cmake = pytest.mark.skipif(not shutil.which("cmake"), reason="needs cmake")


@pytest.mark.slow
@needs_cmake
def test_cmake_builds_it_too(folder, tmp_path):
    runs(
        ["cmake", "-S", folder, "-B", tmp_path],
        ["cmake", "--build", tmp_path],
        ["ctest", "--test-dir", tmp_path],
    )


USER = """cmake_minimum_required(VERSION 3.15)
project(user LANGUAGES C)
{canroll}
add_executable(user main.c)
target_link_libraries(user canroll::canroll)
"""
MAIN = """#include "canroll.h"
#include "canroll_epk.h"
#include "canroll_gains.h"
static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_ecu ecu;
int main(void) { return canroll_init(&ecu, &calibration) != 0 || canroll_epk[0] != 'c'; }
"""


@pytest.mark.slow
@needs_cmake
def test_cmake_takes_it_as_a_part_of_another_project(folder, tmp_path):
    (tmp_path / "main.c").write_text(MAIN)
    text = f"add_subdirectory({folder} canroll)"
    (tmp_path / "CMakeLists.txt").write_text(USER.format(canroll=text))
    build = tmp_path / "build"
    runs(["cmake", "-S", tmp_path, "-B", build], ["cmake", "--build", build], [build / "user"])
    # its tests are not those of the project around it
    assert not list(build.rglob("canroll_test*"))
    assert "CANROLL_TESTS:BOOL=OFF" in (build / "CMakeCache.txt").read_text()


@pytest.mark.slow
@needs_cmake
def test_cmake_installs_a_package_of_its_version(folder, tmp_path):
    installed, build = tmp_path / "installed", tmp_path / "build"
    runs(
        ["cmake", "-S", folder, "-B", build, "-DCANROLL_TESTS=OFF"],
        ["cmake", "--build", build],
        ["cmake", "--install", build, "--prefix", installed],
    )
    (tmp_path / "main.c").write_text(MAIN)
    text = f"find_package(canroll {version('canroll')} REQUIRED)"
    (tmp_path / "CMakeLists.txt").write_text(USER.format(canroll=text))
    user = tmp_path / "user"
    prefix = f"-DCMAKE_PREFIX_PATH={installed}"
    runs(
        ["cmake", "-S", tmp_path, "-B", user, prefix],
        ["cmake", "--build", user],
        [user / "user"],
    )
    (tmp_path / "CMakeLists.txt").write_text(
        USER.format(canroll="find_package(canroll 99.0 REQUIRED)")
    )
    command = ["cmake", "-S", str(tmp_path), "-B", str(tmp_path / "newer"), prefix]
    result = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
    assert result.returncode != 0
    assert "compatible" in result.stderr


@pytest.mark.slow
@needs_cmake
@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="needs arm-none-eabi-gcc")
def test_cmake_builds_for_a_bare_cortex_m(folder, tmp_path):
    toolchain = folder / "cmake" / "arm-none-eabi.cmake"
    runs(
        ["cmake", "-S", folder, "-B", tmp_path, f"-DCMAKE_TOOLCHAIN_FILE={toolchain}"],
        ["cmake", "--build", tmp_path],
    )
    library = tmp_path / "libcanroll.a"
    told = runs(["arm-none-eabi-readelf", "-A", library])
    assert "Tag_CPU_name" in told and "v7E-M" in told
    assert "canroll_tick" in runs(["arm-none-eabi-nm", library])


CXX = """#include "canroll.h"
#include "canroll_epk.h"
#include "canroll_gains.h"
static const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
static canroll_ecu ecu;
int main()
{
    const uint8_t payload[8] = { 0 };
    if (canroll_init(&ecu, &calibration) != 0) return 1;
    canroll_receive(&ecu, 0, payload, canroll_signals_rx_lengths[0]);
    canroll_tick(&ecu, &calibration, 1);
    return ecu.time == 1 && canroll_epk[0] == 'c' ? 0 : 1;
}
"""


@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_its_headers_suit_cxx(folder, tmp_path):
    (tmp_path / "main.cpp").write_text(CXX)
    flags = ["-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{folder / 'include'}"]
    sources = sorted((folder / "src").glob("*.c"))
    objects = [tmp_path / f"{path.stem}.o" for path in sources]
    for source, out in zip(sources, objects, strict=True):
        runs([native.compiler(), "-std=c99", *flags, "-c", source, "-o", out])
    program = tmp_path / "program"
    runs(
        ["g++", "-std=c++11", *flags, tmp_path / "main.cpp", *objects, "-o", program],
        [program],
    )


def test_a_calibration_goes_to_a_programmer(tmp_path):
    bincopy = pytest.importorskip("bincopy", reason="needs canroll[target]")
    record = ecu_traffic.random_calibration(4)
    for path in flash.write(tmp_path, record, 0x0803_F000):
        file = bincopy.BinFile(str(path))
        assert file.minimum_address == 0x0803_F000
        assert bytes(file.as_binary()) == memory_image.image(record)
    for address in (2, -4, 2**32 - 4):
        with pytest.raises(CanrollError, match="multiple of 4"):
            flash.write(tmp_path, record, address)


@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_the_image_says_which_tool_and_calibration_it_is_of(folder):
    assert make(folder, "example.elf").returncode == 0
    header = (folder / "include" / "canroll_epk.h").read_text()
    image = (folder / "example.elf").read_bytes()
    assert re.search(r'CANROLL_EPK "(.*)"', header)[1].encode() + b"\0" in image
    assert memory_image.image(ecu_traffic.random_calibration(3)) in image


def test_the_readme_tells_what_an_interrupt_shares(folder):
    text = (folder / "README.md").read_text()
    assert interrupts.table() in text
    assert "| `rx_fresh` | writes | reads, writes |" in text


def test_the_image_has_the_name_that_the_a2l_asks_for(folder):
    header = (folder / "include" / "canroll_epk.h").read_text()
    epk = re.search(r'CANROLL_EPK "(.*)"', header)[1]
    assert epk.startswith("canroll ")
    assert f'EPK "{epk}"' in (folder / "canroll.a2l").read_text()


def test_a_users_own_bus_without_e2e(tmp_path):
    (tmp_path / "own.dbc").write_text(DBC)
    (tmp_path / "own.toml").write_text(MAP)
    record = ecu_traffic.random_calibration(3)
    record.e2e = 0
    memory_image.sealed(record)
    traffic = ecu_traffic.random_traffic(2, 60, hostile=1.0)
    out = tmp_path / "out"
    bundle.write(out, export(record, traffic, tmp_path / "own.dbc", tmp_path / "own.toml"))
    result = make(out, "test")
    assert result.returncode == 0, result.stderr + result.stdout
    source = (out / "src" / "canroll_signals.c").read_text()
    assert "291, 0, 0, 292, 0" in source
    readme = (out / "README.md").read_text()
    assert "| receive | 0 | 0x123 | 5 | none | Inertial |" in readme
    assert "no end-to-end protection" in readme
    assert "canroll_codec_inertial_unpack" in (out / "codec" / "canroll_codec.h").read_text()
    assert cantools.database.load_file(out / "own.dbc").get_message_by_name("Forces")


SHORT = """#include <stdlib.h>
#include <string.h>
#include "canroll.h"
static canroll_ecu ecu;
int main(void)
{
    uint8_t *payload = malloc(5);
    memset(payload, 85, 5);
    canroll_receive(&ecu, 0, payload, 5);
    canroll_receive(&ecu, 0, payload, 4);
    free(payload);
    return ecu.rx_fresh[0] == 1 && ecu.rx_payload[0][4] == 85 && ecu.rx_payload[0][5] == 0 ? 0 : 1;
}
"""


def test_receive_reads_no_more_than_the_frame_has(tmp_path):
    (tmp_path / "own.dbc").write_text(DBC)
    (tmp_path / "own.toml").write_text(MAP)
    files = bundle.sources(tmp_path / "own.dbc", tmp_path / "own.toml")
    for name, text in {**files, "short.c": SHORT}.items():
        (tmp_path / name).write_text(text)
    program = tmp_path / "short"
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined"]
    sources = [str(path) for path in sorted(tmp_path.glob("*.c"))]
    build = [native.compiler(), *flags, "-o", str(program), *sources]
    for command in (build, [str(program)]):
        result = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
        assert result.returncode == 0, result.stderr


def test_the_readme_leaves_no_gap(folder):
    text = (folder / "README.md").read_text()
    assert "{" not in text.replace("{ ", "")


def test_an_image_without_the_records_is_refused(tmp_path):
    with pytest.raises(CanrollError, match="no such image"):
        export_c.address(tmp_path, tmp_path / "none.elf", None)


def compared(folder, *options):
    """Build the comparison of a bundle's codec with cantools and run it."""
    result = make(folder, "build/codec", "CFLAGS=-std=c99 -O1 -Wall -Wextra -Wpedantic -Werror")
    assert result.returncode == 0, result.stderr
    command = [sys.executable, str(folder / "test" / "test_codec.py"), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)


def test_its_codec_is_what_cantools_says(folder):
    result = compared(folder, "--frames", "200")
    assert result.returncode == 0, result.stdout
    # five messages received, five sent, and five pages of the diagnostics
    assert result.stdout.count("PASS") == 15


def test_another_codec_is_noticed(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "changed")
    source = tmp_path / "changed" / "src" / "canroll_signals.c"
    text = source.read_text()
    rounded = "canroll_rsh32(ecu->force[0], 15)"
    for old, new in (("767603923", "767603900"), (rounded, "(ecu->force[0] >> 15)")):
        assert old in text
        source.write_text(text.replace(old, new))
        result = compared(tmp_path / "changed", "--frames", "2000")
        assert result.returncode == 1 and "FAIL" in result.stdout


def test_without_cantools_the_comparison_is_skipped(folder, tmp_path):
    (tmp_path / "cantools.py").write_text("raise ImportError")
    result = subprocess.run(
        [sys.executable, str(folder / "test" / "test_codec.py")],
        env={"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stdout) == (0, "SKIP: needs the Python package cantools\n")
