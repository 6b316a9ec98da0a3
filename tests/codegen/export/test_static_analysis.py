"""cppcheck with MISRA, and the sanitizers over hostile traffic, on the exported sources."""

import shutil
import subprocess

import pytest

from codegen.c99 import emit
from codegen.export import bundle, misra
from codegen.export.header import gains_header
from codegen.generated import signals
from codegen.run import ecu_traffic, native


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_cppcheck_and_misra_find_only_what_is_documented(tmp_path):
    for name, text in emit.firmware().items():
        (tmp_path / name).write_text(text)
    found = misra.cppcheck(tmp_path, tmp_path)
    unexplained = {rule: where for rule, where in found.items() if rule not in misra.DEVIATIONS}
    assert unexplained == {}
    assert set(misra.DEVIATIONS) <= set(found), "a deviation that no longer happens"
    assert len(misra.DEVIATIONS) <= 5


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_cppcheck_does_find_faults(tmp_path):
    (tmp_path / "bad.c").write_text(
        "int f(int a);\nint f(int a) { int t[2]; t[0] = a; goto end; end: return t[3]; }\n"
    )
    assert {"15.1", "arrayIndexOutOfBounds"} <= set(misra.cppcheck(tmp_path, tmp_path))


@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize("seed", [3, pytest.param(9, marks=pytest.mark.slow)])
def test_sanitizers_have_nothing_to_say(tmp_path, seed):
    record = ecu_traffic.random_calibration(seed)
    bundle.write(
        tmp_path,
        bundle.Export(
            record=record,
            gains=gains_header(record, title=["sample"]),
            title="A sample.",
            dbc=signals.DBC,
            map_file=signals.MAP,
            traffic=ecu_traffic.random_traffic(seed, 200, hostile=0.5),
            origin="Random.",
        ),
    )
    flags = "-std=c99 -O1 -g -fsanitize=undefined,address -fno-sanitize-recover=all"
    result = subprocess.run(
        ["make", "-C", str(tmp_path), "test", f"CFLAGS={flags}"],
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "PASS" in result.stdout
