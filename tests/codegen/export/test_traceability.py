"""Requirements, functions, C lines, obligations and tests: complete, and as they are."""

import ast
import re
from pathlib import Path

import pytest
from support import float_bus

from canroll import dbc
from canroll.codegen.c99.linkage import linkage
from canroll.codegen.export import traceability
from canroll.codegen.export.traceability import Requirement, requirements
from canroll.codegen.generated import own_stage, signals
from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import (
    AUTHENTICATION,
    built_in,
    of_bus,
    with_services,
    with_stage,
)
from canroll.codegen.run.service import SERVICES
from canroll.codegen.run.specialised import specialised
from canroll.errors import CanrollError

ROOT = Path(__file__).parents[3]
SERVED = with_services(built_in(), (*SERVICES, AUTHENTICATION))


@pytest.fixture(scope="module")
def found():
    return traceability.rows(SERVED.program(), SERVED.files)


@pytest.mark.slow
def test_every_requirement_has_functions_and_tests_that_exist(found):
    defined = {}
    for its in requirements():
        assert its.text.endswith(".") and its.tests and found[its.name], its.name
        for test in its.tests:
            file, _, name = test.partition("::")
            if file not in defined:
                tree = ast.parse((ROOT / "tests" / file).read_text())
                defined[file] = {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
            assert name in defined[file], test
        assert len(set(its.tests)) == len(its.tests)


@pytest.mark.slow
def test_every_function_has_one_requirement(found):
    program = SERVED.program()
    for function in program.functions():
        asked = [its.name for its in requirements() if its.covers(function)]
        assert len(asked) == 1, f"{function.key}: {asked}"
    functions = [row.function for rows in found.values() for row in rows]
    # those that only other frames need are not translated
    assert sorted(functions) == sorted(".".join(key) for key in linkage(program).reachable)
    assert found[""] == []


def test_no_pattern_is_left_over(tmp_path):
    functions = list(SERVED.program().functions())
    functions += of_bus(*float_bus.write(tmp_path)).program().functions()
    for its in requirements():
        for pattern in its.functions:
            one = Requirement(its.name, its.text, (pattern,), its.tests)
            assert any(one.covers(function) for function in functions), pattern


def test_a_function_that_nobody_asked_for_is_named(monkeypatch):
    fewer = tuple(its for its in requirements() if its.name != "limits")
    monkeypatch.setattr(traceability, "requirements", lambda: fewer)
    with pytest.raises(CanrollError, match=r"control_law\.limited has requirements: none"):
        traceability.rows(built_in().program(), built_in().files)


def test_the_lines_are_those_of_source_and_c(found):
    program = SERVED.program()
    for rows in found.values():
        for row in rows:
            module, name = row.function.split(".")
            file, _, span = row.source.partition(":")
            first, last = map(int, span.split("–"))
            source = program.modules[Path(file).stem].source.splitlines()
            assert source[first - 1].startswith(f"def {name}(")
            assert last == len(source) or not source[last].startswith("    ")
            file, _, line = row.emitted.removeprefix("src/").partition(":")
            text = SERVED.files[file].splitlines()[int(line) - 1]
            assert f"canroll_{module}_{name}(" in text or f"canroll_{name}(" in text
            assert not text.endswith(";")


def test_obligations_are_those_of_the_proof(found):
    count = {row.function: row.obligations for rows in found.values() for row in rows}
    # v / 2**n: the sum for rounding, the shift count, the result
    assert count["fixed_point.quotient"] >= 2
    assert all(count[name] > 5 for name in ("ecu.init", "observer.advance", "check.check_ranges"))
    assert sum(count.values()) > 2000


@pytest.mark.slow
def test_code_for_one_calibration_is_traced_as_far_as_it_is_reached():
    special = with_services(specialised(built_in(), ecu_traffic.random_calibration(7)), ("nvm",))
    program = special.program()
    traced = traceability.rows(program, special.files)
    rows = [row for functions in traced.values() for row in functions]
    emitted = [row for row in rows if row.emitted != traceability.NO_CODE]
    # every function of the source once, every function of the C
    assert len({row.emitted for row in emitted}) == len(emitted)
    reached = {".".join(key) for key in linkage(program).reachable}
    assert sorted(reached) == sorted(row.function for row in rows)
    text = "".join(text for name, text in special.files.items() if name.endswith(".c"))
    assert len(re.findall(r"\n}\n", text)) == len(emitted)
    for row in emitted:
        module, name = row.function.split(".")
        file, _, line = row.emitted.removeprefix("src/").partition(":")
        head = special.files[file].splitlines()[int(line) - 1]
        assert f"_{name}" in head and not head.endswith(";")
        assert row.source.startswith(f"{module}.py:")
    assert 0 < len(rows) - len(emitted) < len(rows) / 2


def test_an_own_stage_stands_for_itself():
    stage = own_stage.read(ROOT / "examples" / "own_stage" / "progressive.py")
    firmware = with_stage(built_in(), stage)
    page = traceability.page(firmware, firmware.files)
    assert "## own stage" in page
    assert "| `stage.moment` | progressive.py:56–62 | src/canroll_stage.c:" in page


CHECKSUM = """from typing import Annotated

from canroll.firmware.subset import i32, u8


def inverted(payload: Annotated[list[u8], 8], identifier: i32) -> i32:
    return (payload[1] ^ identifier) & 255
"""
OWN = """message = "Imu"
protection.profile = "own"
protection.checksum = { signal = "Checksum", function = "own.py:inverted" }
"""


@pytest.mark.slow
def test_an_own_checksum_stands_for_itself(tmp_path):
    (tmp_path / "own.py").write_text(CHECKSUM)
    table = signals.MAP.read_text(encoding="utf-8").replace('message = "Imu"\n', OWN)
    (tmp_path / "car.toml").write_text(table, encoding="utf-8")
    firmware = of_bus(dbc.PATH, tmp_path / "car.toml")
    rows = traceability.rows(firmware.program(), firmware.files)
    assert [(row.function, row.source) for row in rows[""]] == [
        ("maker_own.inverted", "own.py:6–7")
    ]
