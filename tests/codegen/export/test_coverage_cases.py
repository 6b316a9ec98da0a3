"""The shipped cases reach every statement and branch of the exported C, but for those listed."""

import json
import shutil
import subprocess

import pytest

from canroll.codegen.c99 import emit
from canroll.codegen.export import coverage_cases
from canroll.codegen.export.bundle import TEMPLATES
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import built_in

pytestmark = [
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
    pytest.mark.skipif(
        not shutil.which("gcc") or not shutil.which("gcov"), reason="needs gcc, gcov"
    ),
]


def built(folder, *, flags):
    """The loop with the cases' runner; return the program."""
    for name, text in emit.firmware().items():
        (folder / name).write_text(text)
    (folder / "session_cases.c").write_text(coverage_cases.general(built_in()))
    for name in ("session.h", "test_session.c"):
        shutil.copy(TEMPLATES / name, folder)
    sources = sorted(path.name for path in folder.glob("*.c"))
    subprocess.run(["gcc", "-std=c99", *flags, "-o", "cases", *sources], cwd=folder, check=True)
    return folder / "cases"


def reached(folder):
    """Counts of statements by file and line, and of branches, all copies of a line together."""
    data = sorted(path.name for path in folder.glob("*canroll*.gcda"))
    found = subprocess.run(
        ["gcov", "--branch-probabilities", "--json-format", "--stdout", *data],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    statements, branches = {}, {}
    for document in found.stdout.splitlines():
        for file in json.loads(document)["files"]:
            for line in file["lines"]:
                place = (file["file"], line["line_number"])
                statements[place] = statements.get(place, 0) + line["count"]
                for k, branch in enumerate(line["branches"]):
                    branches[place, k] = branches.get((place, k), 0) + branch["count"]
    return statements, branches


@pytest.mark.slow
def test_every_statement_and_branch_is_reached_or_listed(tmp_path):
    program = built(tmp_path, flags=["-O0", "--coverage"])
    done = subprocess.run([program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    statements, branches = reached(tmp_path)
    assert len(statements) > 1200 and len(branches) > 500
    text = {name: (tmp_path / name).read_text().splitlines() for name, _ in statements}
    left = {place for (place, _), count in branches.items() if not count}
    listed = {(file, text[file][line - 1].strip()) for file, line in left}
    assert listed == set(coverage_cases.UNREACHED)
    # what is never run stands right under a branch that is listed
    assert {(file, line - 1) for (file, line), n in statements.items() if not n} <= left
    assert all(coverage_cases.UNREACHED.values())


@pytest.mark.slow
def test_the_runner_finds_another_state(tmp_path):
    program = built(tmp_path, flags=["-O0"])
    assert subprocess.run([program], capture_output=True, check=False).returncode == 0
    path = tmp_path / "canroll_control_law.c"
    changed = path.read_text().replace("ecu->front_share = cal->schedule_front_share[0]", "(void)0")
    assert changed != path.read_text()
    path.write_text(
        changed.replace(
            "const canroll_calibration *cal)\n{\n    (void)0",
            "const canroll_calibration *cal)\n{\n    (void)cal; (void)ecu",
        )
    )
    sources = sorted(each.name for each in tmp_path.glob("*.c"))
    subprocess.run(["gcc", "-std=c99", "-o", "cases", *sources], cwd=tmp_path, check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stdout.startswith("FAIL: ")


@pytest.mark.slow
def test_no_case_does_what_c_leaves_undefined(tmp_path):
    flags = ["-O1", "-fsanitize=undefined,address", "-fno-sanitize-recover=all"]
    program = built(tmp_path, flags=flags)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_case_has_one_name_and_refusals_have_all_rules():
    rules = set()
    machine = native.NativeMachine(built_in())
    for case in coverage_cases.cases(built_in().bus):
        ecu, cal = machine.record(built_in().record()), machine.record(case.record)
        rules.add(machine.call("init", ecu, cal))
    assert set(range(501, 512)) <= rules and 0 in rules and any(0 < rule < 200 for rule in rules)
