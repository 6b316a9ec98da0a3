"""Fuzzing of the compiled firmware under the sanitizers: bounded, and that it finds faults."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from canroll.codegen.run import ecu_traffic, native
from tools import fuzz_firmware as fuzzing

ROOT = Path(__file__).parents[2]
OWN_BUS = ROOT / "examples" / "own_bus"


def sanitizers():
    """Whether the C compiler links the sanitizers' libraries."""
    if native.compiler() is None:
        return False
    command = [native.compiler(), "-fsanitize=address,undefined", "-xc", "-", "-o", "/dev/null"]
    source = b"int main(void) { return 0; }"
    return subprocess.run(command, input=source, capture_output=True, check=False).returncode == 0


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sanitizers(), reason="needs gcc: apt-get install gcc libc6-dev"),
]


@pytest.fixture(scope="module")
def calibrations():
    return [ecu_traffic.random_calibration(seed) for seed in range(12)]


@pytest.mark.parametrize(
    ("bus", "services"),
    [((None, None), ("xcp", "uds")), ((OWN_BUS / "own.dbc", OWN_BUS / "own.toml"), None)],
)
def test_no_input_crashes_the_firmware(bus, services, calibrations, tmp_path):
    firmware = fuzzing.firmware_of(*bus)
    assert services is None or firmware.services == services
    program = fuzzing.build(firmware, calibrations, tmp_path)
    done = fuzzing.fuzz(program, 60_000, 1)
    assert done.returncode == 0
    assert "60000 inputs" in done.stdout
    assert "0 crashes" in done.stdout


@pytest.mark.parametrize(
    ("taken_out", "symptom"),
    [
        (("canroll_mailbox.c", "if (length < size)", "if (0)"), "heap-buffer-overflow"),
        pytest.param(
            ("canroll_mailbox.c", "(frame >= CANROLL_N_FRAMES)", "(0)"),
            "runtime error",
            marks=pytest.mark.long,
        ),
        pytest.param(
            (
                "canroll_ecu.c",
                "canroll_clamp32(elapsed_ticks, 1, CANROLL_AGE_MAX)",
                "elapsed_ticks",
            ),
            "outside",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_guard_taken_out_is_found(taken_out, symptom, calibrations, tmp_path, capfd):
    file, guard, instead = taken_out
    firmware = replace(fuzzing.firmware_of(None, None))
    assert guard in firmware.files[file]
    spoilt = firmware.files[file].replace(guard, instead)
    firmware.__dict__["files"] = {**firmware.files, file: spoilt}
    program = fuzzing.build(firmware, calibrations, tmp_path)
    assert fuzzing.fuzz(program, 60_000, 1).returncode != 0
    assert symptom in capfd.readouterr().err
    again = subprocess.run(
        [program, "--repeat", tmp_path / "crash"],
        capture_output=True,
        text=True,
        check=False,
        env=fuzzing.ENVIRONMENT,
    )
    assert again.returncode != 0
    assert symptom in again.stderr
