"""The bundle on a board: the node around the loop, bare, under FreeRTOS and under Zephyr."""

import json
import os
import re
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest
from support.bundles import export, make

from canroll.codegen.export import bundle
from canroll.codegen.run import cortex, ecu_traffic, native

pytestmark = pytest.mark.slow

RECORD = ecu_traffic.random_calibration(7)
needs_qemu = pytest.mark.skipif(
    not cortex.has_gcc_and_qemu(),
    reason="needs packages gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm",
)
COUNTED = """
#include <stdio.h>
#include "node.h"
static int alive;
static int sent;
int node_next(uint32_t *identifier, uint8_t payload[NODE_BYTES], int32_t *length)
{
    (void)identifier, (void)payload, (void)length;
    return 0;
}
void node_send(uint32_t identifier, const uint8_t *payload, int32_t length, int32_t fd)
{
    (void)identifier, (void)payload, (void)length;
    sent += fd == 0;
}
void node_alive(void) { alive++; }
int main(void)
{
    int started = (int)node_start();
    for (int k = 0; k < 50; k++) {
        node_tick(1 + k % 3);
    }
    printf("%d %d %d %d\\n", started, alive, (int)node_time(), sent > 0);
    return 0;
}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("boards")
    bundle.write(path, export(RECORD, traffic=ecu_traffic.random_traffic(3, 20)))
    return path


def counted(folder, tmp_path):
    """Run the node on this machine: its start, and how often it was alive in 50 ticks."""
    (tmp_path / "counted.c").write_text(COUNTED)
    files = [*sorted((folder / "src").glob("*.c")), folder / "board" / "node.c"]
    command = [native.compiler(), "-std=gnu99", "-Wall", "-Wextra", "-Werror"]
    command += [f"-I{folder / name}" for name in ("include", "board")]
    command += ["-o", tmp_path / "counted", tmp_path / "counted.c", *files]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    ran = subprocess.run([tmp_path / "counted"], capture_output=True, text=True, check=True)
    return ran.stdout.split()


@pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")
def test_a_node_is_alive_once_for_each_tick_that_ran_to_its_end(folder, tmp_path):
    time = sum(1 + k % 3 for k in range(50))
    assert counted(folder, tmp_path) == ["0", "50", str(time), "1"]


@pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")
def test_a_refused_calibration_is_never_alive(folder, tmp_path):
    header = folder / "include" / "canroll_gains.h"
    text = header.read_text()
    wrong = re.sub(r"(/\* crc \*/ \\\n +)-?\d+", r"\g<1>0", text)
    assert wrong != text
    header.write_text(wrong)
    found = counted(folder, tmp_path)
    header.write_text(text)
    assert found == ["511", "0", "0", "0"]


@needs_qemu
def test_the_bare_example_runs_its_periods(folder):
    result = make(folder, "run-example")
    assert result.returncode == 0, result.stderr + result.stdout
    assert "warning" not in result.stderr and "\nPASS\n" in result.stdout


@needs_qemu
@pytest.mark.outside
def test_the_example_runs_as_a_task_of_freertos(folder):
    kernel = Path(os.environ.get("FREERTOS_KERNEL", ""))
    if not (kernel / "tasks.c").is_file():
        pytest.skip("needs FREERTOS_KERNEL, a folder of github.com/FreeRTOS/FreeRTOS-Kernel")
    result = make(folder, "run-freertos", f"FREERTOS={kernel}")
    assert result.returncode == 0, result.stderr + result.stdout
    assert "warning" not in result.stderr and "\nPASS\n" in result.stdout


@pytest.mark.outside
def test_the_sample_builds_with_zephyr(folder, tmp_path):
    if not Path(os.environ.get("ZEPHYR_BASE", ""), "Kconfig.zephyr").is_file():
        pytest.skip("needs ZEPHYR_BASE, a folder of github.com/zephyrproject-rtos/zephyr")
    source = folder / "zephyr" / "sample"
    configure = ["cmake", "-S", source, "-B", tmp_path, "-GNinja", "-DBOARD=native_sim/native/64"]
    for command in (configure, ["cmake", "--build", tmp_path]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr + done.stdout


def test_the_manifests_name_what_is_there(folder):
    module = (folder / "zephyr" / "module.yml").read_text()
    assert (folder / re.search(r"^  cmake: (.+)$", module, re.M)[1] / "CMakeLists.txt").is_file()
    assert (folder / re.search(r"^  kconfig: (.+)$", module, re.M)[1]).is_file()
    assert (folder / re.search(r"^  - (.+)$", module, re.M)[1] / "sample.yaml").is_file()
    library = json.loads((folder / "library.json").read_text())
    assert library["version"] == version("canroll")
    for name in library["headers"]:
        assert (folder / library["build"]["includeDir"] / name).is_file()


def test_the_clock_of_freertos_has_whole_periods():
    wanted = {10_000: 1000, 1000: 1000, 5000: 1000, 2500: 800, 1001: 1_000_000}
    for period, rate in wanted.items():
        assert bundle._ticks_a_second(period) == rate
        assert period * rate % 1_000_000 == 0
