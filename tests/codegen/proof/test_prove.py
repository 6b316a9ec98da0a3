"""The prover: finds what is wrong, accepts what is right, and never misses what really happens."""

from itertools import product

import pytest

from canroll.cli import prove as command
from canroll.cli.main import parse
from canroll.codegen.operations import intervals as iv
from canroll.codegen.operations.intervals import Value
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import ecu_traffic, memory_image
from canroll.codegen.run.bus_firmware import built_in
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import copy_sources, file_of
from canroll.errors import CanrollError
from canroll.firmware import subset
from canroll.firmware.calibration import Calibration

WRONG = {
    "overflow": (
        "a: i64 = ecu.x[0] * MASK\nb: i64 = a * MASK  # here\necu.count = clamp(b, 0, 9)",
        "overflows 64 bits",
    ),
    "field": ("ecu.count = ecu.count + 1  # here", "count is declared in [0, 100]: [1, 101]"),
    "index": ("ecu.x[clamp(ecu.count, 0, 3)] = 1  # here", "index of 3 elements: [0, 3]"),
    "row": ("ecu.m[0][ecu.small] = 1  # here", "index of 2 elements: [0, 9]"),
    "divisor": ("ecu.count = clamp(tdiv(5, ecu.small), 0, 5)  # here", "divides by zero"),
    "shift": ("a: i64 = rsh(5, ecu.small)  # here\necu.count = clamp(a, 0, 5)", "shift count"),
    "rounding": (
        "a: i64 = ecu.x[0] * (1 << 53)\nb: i64 = rsh(a, 62)  # here\necu.count = clamp(b, 0, 5)",
        "rounding overflows 64 bits",
    ),
    "narrow": ("a: i32 = narrow(ecu.x[0] * MASK)  # here\necu.count = clamp(a, 0, 5)", "i32"),
    "local": ("a: i32 = ecu.x[0] * MASK  # here\necu.count = clamp(a, 0, 5)", "does not fit i32"),
    "31 bits": ("ecu.count = sat31(ecu.x[0] * MASK)  # here", "[-1073741824, 1073741823]"),
    "scaling": ("a: i64 = scaled(5, ecu.small)  # here\necu.count = clamp(a, 0, 5)", "shift count"),
    "word": (
        "a: i32 = word(ecu, ecu.small + 8)  # here\necu.count = clamp(a, 0, 5)",
        "index of 12 elements: [8, 17]",
    ),
    "loop": (
        "a: i32 = 0\nfor k in range(4):\n a += 1 << 30  # here\necu.count = clamp(a, 0, 5)",
        "does not fit i32",
    ),
}

RIGHT = """
def head(ecu: Ecu, k: i32) -> i32:
    if k < 0 or k >= N:
        return 0
    return ecu.x[k]


def good(v: i32) -> i32:
    if v >= 1 and v <= 3:
        return 1
    return 0


def run(ecu: Ecu, cal: Calibration, k: i32) -> None:
    acc: i64 = 0
    for j in range(cal.order):
        acc += cal.gain[j] * ecu.x[j]
    ecu.x[0] = clamp(rsh(acc, 31), -1000, 1000)
    step: i32 = ecu.small + 1
    if step > 9:
        step = 0
    ecu.small = byte(step)
    if good(k) == 1:
        ecu.x[k - 1] = 0
    asked: i32 = good(k)
    if asked == 0:
        return
    ecu.count = clamp(tdiv(100, k), 0, 100)
    ecu.x[1] = head(ecu, k)
"""


FILL = """
def fill(ecu: Ecu, v: i32) -> i32:
    if v < 5:
        ecu.count = 100
        return 1
    return 0
"""
AFTER_CALLS = {
    "the other branch": """
def half(v: i32) -> i32:
    return rsh(v, 1)

def run(ecu: Ecu) -> None:
    step: i32 = 200
    if half(ecu.count) > ecu.small:
        step = 100
    ecu.count = step  # here
""",
    "the argument is written by the call": FILL
    + """
def run(ecu: Ecu) -> None:
    if fill(ecu, ecu.count) == 1:
        ecu.count = ecu.count + 1  # here
""",
    "the argument is written by the call of a declaration": FILL
    + """
def run(ecu: Ecu) -> None:
    full: i32 = fill(ecu, ecu.count)
    if full == 1:
        ecu.count = ecu.count + 1  # here
""",
    "what is compared is written by the call": """
def fill(ecu: Ecu) -> i32:
    ecu.count = 100
    return 100

def run(ecu: Ecu) -> None:
    if ecu.count < fill(ecu):
        ecu.count = ecu.count + 1  # here
""",
}


CHAIN = "".join(f"    {a}: i32 = 0\n" for a in "abcdefgh")
HANDED_ON = "".join(f"        {a} = {b}\n" for a, b in zip("abcdefg", "bcdefgh", strict=True))
LOOPS = {
    "a number handed on for more rounds than are tried": (
        f"def run(ecu: Ecu) -> None:\n{CHAIN}    for k in range(100):\n{HANDED_ON}"
        "        h = 4\n    ecu.x[a] = 1  # here\n",
        "index of 3 elements",
    ),
    "a step from an unknown start": (
        """
def run(ecu: Ecu) -> None:
    first: i32 = clamp(ecu.count, 0, 1)
    for k in range(first, 4, 2):
        ecu.x[k] = 99  # here
""",
        "index of 3 elements: [0, 3]",
    ),
    "a step down from an unknown start": (
        """
def run(ecu: Ecu) -> None:
    first: i32 = clamp(ecu.count, 1, 2)
    for k in range(first, -2, -2):
        ecu.x[k] = 99  # here
""",
        "index of 3 elements: [-1, 2]",
    ),
    "a counter that C adds a step to once more": (
        """
def run(ecu: Ecu) -> None:
    for k in range(2147483640, 2147483647, 3):  # here
        ecu.count = 1
""",
        "the counter does not fit i32",
    ),
    "a bound of more than 32 bits": (
        """
def run(ecu: Ecu) -> None:
    last: i64 = MASK + ecu.count
    for k in range(last):  # here
        ecu.count = 1
""",
        "does not fit i32",
    ),
    "bounds of all 64 bits": (
        """
def run(ecu: Ecu, first: i64, last: i64) -> None:
    for k in range(first, last):  # here
        ecu.count = 1
""",
        "does not fit i32",
    ),
    "a record that zero is not in, cleared": (
        """
from canroll.firmware.subset import F, record

@record
class Own:
    a: Annotated[i32, F(1, 900, 0, "", "")]

def run(own: Own) -> None:
    for k in range(100):
        clear(own)  # here
""",
        "a can't be zero",
    ),
    "a bound of the one record on the other": (
        """
def run(one: Ecu, two: Ecu) -> None:
    if one.count < 3:
        one.x[two.count] = 1  # here
""",
        "index of 3 elements: [0, 100]",
    ),
}


@pytest.mark.parametrize("name", LOOPS)
def test_no_loop_or_record_is_taken_for_less_than_it_does(sample, name):
    text, what = LOOPS[name]
    path = sample.write(text)
    findings = prove(load("sample", path)).findings
    assert (findings[0].line, what in str(findings[0])) == (sample.line_of("# here"), True)


def test_what_holds_of_one_record_of_a_class_is_known_of_it(sample):
    path = sample.write("""
def inner(ecu: Ecu, other: Ecu) -> None:
    if ecu.count < 3:
        other.x[ecu.count] = 1

def run(one: Ecu, two: Ecu) -> None:
    inner(two, one)
    inner(one, one)
""")
    assert prove(load("sample", path)).findings == ()


@pytest.mark.parametrize("name", AFTER_CALLS)
def test_what_a_call_in_a_condition_leaves_is_not_taken_for_less(sample, name):
    path = sample.write(AFTER_CALLS[name])
    (finding,) = prove(load("sample", path)).findings
    assert finding.line == sample.line_of("# here")
    assert "count is declared" in finding.what and finding.hi > 100


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named_with_line_and_range(sample, name):
    body, what = WRONG[name]
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    path = sample.write(f"def run(ecu: Ecu) -> None:\n{lines}")
    findings = [str(finding) for finding in prove(load("sample", path)).findings]
    assert findings, name
    assert findings[0].startswith(f"{sample.file}:{sample.line_of('# here')}: ")
    assert what in findings[0]


def test_what_is_right_is_accepted(sample):
    assert prove(load("sample", sample.write(RIGHT))).findings == ()


def test_the_firmware_is_proved():
    proof = prove()
    assert proof.findings == ()
    assert len(proof.seen) > 4000


@pytest.mark.parametrize(
    ("module", "clamped", "bare"),
    [
        (
            "control_law",
            "step: i32 = sat31(steps * cal.slew_max)",
            "step: i32 = steps * cal.slew_max",
        ),
        (
            "allocation",
            "ecu.given = sat31(front - lack + rear)",
            "ecu.given = front - lack + rear",
        ),
        (
            "observer",
            "z[i] = scaled(acc, cal.phi_shift[i])",
            "z[i] = clamp(rsh(acc, cal.phi_shift[i]), -(1 << 30), 1 << 30)",
        ),
    ],
)
def test_a_removed_clamp_is_found(tmp_path, module, clamped, bare):
    copy_sources(tmp_path)
    path = file_of(module, tmp_path)
    source = path.read_text()
    assert source.count(clamped) == 1
    path.write_text(source.replace(clamped, bare))
    findings = prove(load(folder=tmp_path)).findings
    line = source[: source.index(clamped)].count("\n") + 1
    assert f"{path}:{line}: " in " ".join(map(str, findings))


def test_the_command_proves_a_calibration_of_its_own(capsys):
    args = parse(["prove"])
    assert command.report(args, ecu_traffic.random_calibration(1), built_in(), "mine") == 0
    assert "proved for mine" in capsys.readouterr().out
    with pytest.raises(CanrollError, match="rejected by rule"):
        command.report(args, Calibration(), built_in(), "mine")


def test_one_calibration_is_narrower_than_all():
    record = ecu_traffic.random_calibration(1)
    one = prove(calibration=memory_image.elements(record))
    assert one.findings == ()
    assert len(one.seen) < len(prove().seen)


SMALL = [Value(low, high) for low in range(4) for high in range(low, 4)]


def test_a_hull_holds_both_intervals_and_no_more():
    for one, other in product(SMALL, SMALL):
        assert iv.hull(one, other) == Value(min(one.lo, other.lo), max(one.hi, other.hi))


@pytest.mark.parametrize("value", SMALL, ids=str)
def test_the_interval_of_a_clamp_is_that_of_all_its_results(value):
    for low, high in product(SMALL, SMALL):
        its = (range(each.lo, each.hi + 1) for each in (value, low, high))
        results = {subset.clamp(*numbers) for numbers in product(*its)}
        found = iv.clamp(value, low, high)
        assert found.lo <= min(results) and max(results) <= found.hi, (low, high)
        if low.hi <= high.lo:
            assert (found.lo, found.hi) == (min(results), max(results)), (low, high)
