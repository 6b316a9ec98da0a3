"""cppcheck with MISRA, and the sanitizers over hostile traffic, on the exported sources."""

import re
import shutil

import pytest
from support.bundles import export, make
from support.sample import Sample

from canroll import dbc
from canroll.codegen.c99 import emit
from canroll.codegen.export import bundle, misra
from canroll.codegen.run import ecu_traffic, native
from canroll.codegen.run.bus_firmware import built_in, of_bus, with_services
from canroll.codegen.run.service import SERVICES
from canroll.codegen.subset.parse import load


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    """The folder with the loop in C, and what cppcheck finds there, by rule."""
    folder = tmp_path_factory.mktemp("loop")
    for name, text in emit.firmware().items():
        (folder / name).write_text(text)
    return folder, misra.cppcheck(folder, folder)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_cppcheck_and_misra_find_only_what_is_documented(loop):
    _, found = loop
    unexplained = {rule: where for rule, where in found.items() if rule not in misra.DEVIATIONS}
    assert unexplained == {}
    assert set(misra.DEVIATIONS) <= set(found), "a deviation that no longer happens"
    assert len(misra.DEVIATIONS) <= 5


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
@pytest.mark.long
@pytest.mark.parametrize("services", ["beside", "secured"])
def test_nor_do_they_in_the_services(tmp_path, services):
    firmware = with_services(built_in(), tuple(SERVICES))
    if services == "secured":
        firmware = of_bus(dbc.SECURED_PATH, dbc.SECURED_MAP)
    for name, text in firmware.files.items():
        (tmp_path / name).write_text(text)
    found = misra.cppcheck(tmp_path, tmp_path)
    assert {rule: where for rule, where in found.items() if rule not in misra.DEVIATIONS} == {}


def test_a_result_of_operators_is_widened_before_it_is_stored(tmp_path):
    code = "def kept(v: i32, w: i32) -> i64:\n"
    code += "    found: i64 = clamp(v, 0, 9) * clamp(w, 0, 9)\n"
    code += "    found += clamp(v, 0, 9) - clamp(w, 0, 9)\n"
    code += "    return found\n"
    c = emit.emit("sample", Sample(tmp_path).write(code))["canroll_sample.c"]
    assert c.count("canroll_wide(canroll_clamp32(") == 2


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_cppcheck_does_find_faults(tmp_path):
    (tmp_path / "bad.c").write_text(
        "int f(int a);\nint f(int a) { int t[2]; t[0] = a; goto end; end: return t[3]; }\n"
    )
    assert {"15.1", "arrayIndexOutOfBounds"} <= set(misra.cppcheck(tmp_path, tmp_path))


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize("seed", [3, pytest.param(9, marks=pytest.mark.long)])
def test_sanitizers_have_nothing_to_say(tmp_path, seed):
    record = ecu_traffic.random_calibration(seed)
    traffic = ecu_traffic.random_traffic(seed, 200, hostile=0.5)
    bundle.write(tmp_path, export(record, traffic=traffic))
    flags = "-std=c99 -O1 -g -fsanitize=undefined,address -fno-sanitize-recover=all"
    result = make(tmp_path, "test", f"CFLAGS={flags}")
    assert result.returncode == 0, result.stderr
    assert "PASS" in result.stdout


WHERE = {
    "2.5": r"#define CANROLL_\w+ ",
    "10.1": r"<<|>>|&|\||\^|~",
    "11.5": r"canroll_any_word|uint8_t \*\)record",
    "15.5": r"\breturn\b",
}
"""What a line has on which a rule is deviated from, if the reason is true."""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
def test_the_reason_of_a_deviation_is_that_of_every_place(loop):
    folder, found = loop
    names = {c.name for m in load().modules.values() for c in m.constants.values()}
    assert set(WHERE) == set(misra.DEVIATIONS)
    for rule, places in found.items():
        for place in places:
            file, _, number = place.rpartition(":")
            path = folder / file.rpartition("/")[2]
            line = path.read_text().splitlines()[int(number) - 1]
            assert re.search(WHERE[rule], line), f"{rule}: {place}: {line}"
            if rule == "2.5":
                assert any(line.split()[1].endswith(f"_{name}") for name in names), line
            if rule == "11.5":
                assert path.name == "canroll_runtime.h"


def test_what_may_be_negative_is_multiplied_and_not_shifted_left(tmp_path):
    code = "def shifted(v: i32) -> i64:\n    return v << 3\n\n\n"
    code += "def masked(v: i32) -> i32:\n    return (v & 255) << 3\n"
    c = emit.emit("sample", Sample(tmp_path).write(code))["canroll_sample.c"]
    assert c.count("<<") == 2 and "* ((int64_t)1 << 3)" in c and "(v & 255) << 3" in c
    assert "#error" in emit.firmware()["canroll_runtime.h"]
