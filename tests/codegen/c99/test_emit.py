"""The emitter: refused constructs, what the C says, and what gcc says of it."""

import re
import shutil
import subprocess

import pytest

from canroll.codegen.c99 import emit
from canroll.codegen.c99.text import plain
from canroll.codegen.subset.program import SubsetError

WARNINGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion"]
WARNINGS += ["-Wshadow", "-Wpedantic", "-Werror"]
# what a compiler calls by itself for the loops it recognises
COMPILERS_OWN = ("memcpy", "memset", "memmove")

# construct, the words of the refusal; the line at fault is marked by "# here"
REFUSED = {
    "while": ("while ecu.count < 3:  # here\n ecu.count = 1", "while is not in the subset"),
    "floor division": ("a: i32 = ecu.count // 2  # here", "// is not in the subset: use tdiv"),
    "modulo": ("a: i32 = ecu.count % 2  # here", "% is not in the subset: use tdiv"),
    "division": ("a: i32 = ecu.count / 2  # here", "/ is not in the subset: use tdiv"),
    "power": ("a: i32 = ecu.count**2  # here", "** is not in the subset"),
    "invert": ("a: i32 = ~ecu.count  # here", "is not in the subset"),
    "float": ("a: i32 = 1.5  # here", "only integers"),
    "bool": ("ecu.count = True  # here", "only integers"),
    "string": ("ecu.count = 'a'  # here", "only integers"),
    "list": ("ecu.count = [1]  # here", "a list is not in the subset"),
    "lambda": ("ecu.count = (lambda: 1)()  # here", "not a function of the firmware"),
    "comparison as number": ("ecu.count = ecu.small > 1  # here", "a comparison is not a number"),
    "number as condition": ("if ecu.count:  # here\n ecu.count = 1", "write '!= 0'"),
    "chained comparison": ("if 0 < ecu.count < 3:  # here\n ecu.count = 1", "join them by 'and'"),
    "is": ("if ecu.count is 3:  # here\n ecu.count = 1", "not a comparison of integers"),
    "in": ("if ecu.count in TABLE:  # here\n ecu.count = 1", "not a comparison of integers"),
    "undeclared": ("a = 1  # here", "is not declared here"),
    "without value": ("a: i32  # here", "needs a value where it is declared"),
    "declared twice": ("a: i32 = 1\na: i32 = 2  # here", "a is declared twice"),
    "unknown type": ("a: float = 1  # here", "declared as name: i32"),
    "out of scope": (
        "if ecu.count > 1:\n a: i32 = 1\n ecu.count = a\necu.count = a  # here",
        "a is not defined here",
    ),
    "counter after loop": (
        "for k in range(3):\n ecu.count = k\necu.count = k  # here",
        "k is not defined here",
    ),
    "counter assigned": ("for k in range(3):\n k = 2  # here", "belongs to its loop"),
    "loop over table": ("for k in TABLE:  # here\n ecu.count = k", "for name in range"),
    "loop else": ("for k in range(3):  # here\n ecu.count = k\nelse:\n ecu.count = 1", "no else"),
    "moving bound": (
        "n: i32 = 3\nfor k in range(n):  # here\n n = k",
        "the loop changes its bound n",
    ),
    "bound in state": (
        "for k in range(ecu.small):  # here\n ecu.x[0] = k",
        "or a calibration value",
    ),
    "bound in a calibration that is written": (
        "for k in range(cal.order):  # here\n set_octet(cal, k, 1)",
        "a loop's bound must be",
    ),
    "step zero": ("for k in range(0, 3, 0):  # here\n ecu.count = k", "step must not be 0"),
    "break": ("for k in range(3):\n break  # here", "break is not in the subset"),
    "variable shift": ("a: i64 = 1 << ecu.count  # here", "a shift count is a constant"),
    "large shift": ("a: i64 = ecu.count >> 63  # here", "must be 0 to 62"),
    "constant record": ("cal.shift = 3  # here", "the calibration is constant"),
    "constant table": ("TABLE[0] = 3  # here", "TABLE is constant"),
    "unknown field": ("ecu.cuont = 3  # here", "Ecu has no field cuont"),
    "unknown function": ("foo(ecu)  # here", "not a function of the firmware"),
    "builtin": ("ecu.count = abs(ecu.count)  # here", "not a function of the firmware"),
    "keyword": ("a: i32 = clamp(v=1, lo=2, hi=3)  # here", "arguments are positional"),
    "argument count": ("a: i32 = sat32(1, 2)  # here", "sat32 takes 1 arguments"),
    "memory of no record": ("a: i32 = word(ecu.count, 1)  # here", "word takes a record"),
    "cleared constants": ("clear(cal)  # here", "the calibration is constant"),
    "clear as number": ("ecu.count = clear(ecu)  # here", "clear returns nothing"),
    "slice": ("ecu.x[0:2] = 1  # here", "no slices"),
    "array as number": ("a: i32 = ecu.x  # here", "give its indices"),
    "table as number": ("a: i32 = TABLE  # here", "give its indices"),
    "index of scalar": ("a: i32 = ecu.count[0]  # here", "is not an array"),
    "two targets": ("ecu.count = ecu.x[0] = 1  # here", "one assignment at a time"),
    "tuple": ("ecu.count, ecu.x[0] = 1, 2  # here", "a tuple"),
    "no effect": ("ecu.count + 1  # here", "an expression without effect"),
    "pass": ("pass  # here", "pass is not in the subset"),
    "with": ("with ecu:  # here\n ecu.count = 1", "with is not in the subset"),
    "try": ("try:  # here\n ecu.count = 1\nfinally:\n ecu.count = 2", "try is not in the subset"),
    "inner function": ("def g() -> None:  # here\n ecu.count = 1", "a function in a function"),
    "conditional expression": (
        "ecu.count = 1 if ecu.small > 1 else 2  # here",
        "a conditional expression is not in the subset",
    ),
    "return value": ("return 1  # here", "returns a different type than declared"),
    "name of C": ("int: i32 = 1  # here", "another meaning in C"),
    "name of a type": ("x_t: i32 = 1  # here", "another meaning in C"),
    "order of calls": ("ecu.count = set_it(ecu) + set_it(ecu)  # here", "C orders them freely"),
    "call beside read": ("ecu.count = set_it(ecu) + ecu.x[0]  # here", "C orders them freely"),
    "call beside a reading call": (
        "ecu.count = set_it(ecu) + get_it(ecu)  # here",
        "C orders them freely",
    ),
    "call beside memory": (
        "ecu.count = set_it(ecu) + octet(ecu, 0)  # here",
        "C orders them freely",
    ),
    "call that writes what it is added to": ("ecu.count += set_it(ecu)  # here", "C orders them"),
    "call in the index of a target": ("ecu.x[set_it(ecu)] = ecu.x[0]  # here", "C orders them"),
    "call in the index of what is changed": ("ecu.x[set_it(ecu)] &= 5  # here", "C orders them"),
    "clear of bytes": ("clear(flags)  # here", "clear takes a record of words: Flags has none"),
    "word of bytes": ("ecu.x[0] = word(flags, 0)  # here", "takes a record of words"),
    "two types of a name": (
        "for k in range(9):  # here\n ecu.count = k\nif ecu.count > 3:\n k: u32 = 5\n k = k",
        "k is i32 here and u32 elsewhere",
    ),
    "wide bound": ("for k in range(MASK):  # here\n ecu.count = 1", "may not fit i32"),
    "wide in narrow": ("a: i32 = ecu.count << 40  # here", "may not fit i32"),
    "wide in field": ("ecu.x[1] = ecu.x[0] * MASK  # here", "may not fit i32"),
    "negative in byte": ("ecu.small = ecu.x[0]  # here", "may not fit u8"),
    "wide argument": ("take(ecu.count * MASK)  # here", "may not fit i32"),
}

HELPERS = """
from canroll.firmware.subset import F, record, set_octet

@record
class Flags:
    at: Annotated[list[u8], 5, F(0, 255, 0, "", "")]


def set_it(ecu: Ecu) -> i32:
    ecu.count = 1
    return 2


def get_it(ecu: Ecu) -> i32:
    return ecu.count


def take(v: i32) -> None:
    a: i32 = v
    a = a


"""


@pytest.mark.parametrize("name", REFUSED)
def test_refused_construct_names_file_line_and_rule(sample, name):
    body, rule = REFUSED[name]
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    head = "def run(ecu: Ecu, cal: Calibration, flags: Flags) -> None:\n"
    path = sample.write(HELPERS + head + lines)
    with pytest.raises(SubsetError) as caught:
        emit.emit("sample", path)
    place = f"{sample.file}:{sample.line_of('# here')}: "
    assert str(caught.value).startswith(place), caught.value
    assert rule in str(caught.value)


OF_ARRAYS = """
def fill(row: Annotated[list[u8], 4]) -> i32:
    row[0] = 7
    return 1

def run(row: Annotated[list[u8], 4]) -> i32:
    sum: i32 = 0
    {body}
    return sum
"""


@pytest.mark.parametrize(
    ("body", "rule"),
    [
        ("sum = row[0] + 10 * fill(row)  # here", "C orders them freely"),
        ("row[0] += fill(row)  # here", "C orders them freely"),
        ("for k in range(row[0]):  # here\n        row[0] = 9", "a loop's bound must be"),
    ],
)
def test_what_is_read_of_an_array_beside_a_write_is_refused(sample, body, rule):
    path = sample.write(OF_ARRAYS.format(body=body))
    with pytest.raises(SubsetError, match=rule) as caught:
        emit.emit("sample", path)
    assert f"{sample.file}:{sample.line_of('# here')}: " in str(caught.value)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("import math\n", "only canroll.firmware is imported, not math"),
        ("from math import sin\n", "only canroll.firmware is imported"),
        ("from canroll.firmware.state import N as M\n", "remove 'as'"),
        ("X = 1.5\n", "not a constant of ints"),
        ("X = (1, 2)\n", "a table states its type"),
        ("X: tuple[u8, ...] = (1, 256)\n", "256 does not fit u8"),
        ("for i in range(3):\n    N = i\n", "a module holds"),
        ("class A:\n    pass\n", "a class is a @record"),
        ("def f(a) -> None:\n    a = 1\n", "states its type"),
        ("def f(a: i32):\n    return a\n", "states what it returns"),
        ("def f(a: i32 = 1) -> i32:\n    return a\n", "without defaults"),
        ("def f(*a: i32) -> i32:\n    return 1\n", "positional"),
        ("def f(a: float) -> i32:\n    return 1\n", "is no type"),
        ("@record\ndef f(a: i32) -> i32:\n    return a\n", "no decorators"),
        ("def f(a: i32) -> i32:\n    return f(a)\n", "no recursion"),
        ("def f(a: i32) -> i32:\n    if a > 1:\n        return 1\n", "must end in a return"),
        ("def f(e: Ecu) -> Ecu:\n    return e\n", "returns a scalar or None"),
    ],
)
def test_refused_module_contents(sample, text, rule):
    with pytest.raises(SubsetError, match=re.escape(rule)) as caught:
        emit.emit("sample", sample.write(text))
    assert str(caught.value).startswith(str(sample.file))


GOOD = '''
def inner(ecu: Ecu, row: Annotated[list[i32], 2], k: i32) -> i32:
    """Return a sum, with ``k``."""
    # of the row
    row[0] = clamp(row[1] + k, -8, 8)  # first
    if ecu.count > 3 and (k != 2 or not ecu.small == 1):
        return row[0] - 1
    elif k == I32_MAX:
        return -TABLE[1]
    else:
        return tdiv(k, 3)


def run(ecu: Ecu, cal: Calibration, k: i32) -> i32:
    acc: i64 = 0
    for j in range(cal.order):
        acc += cal.gain[j] * ecu.x[j]
    for _ in range(2):
        for _ in range(2):
            acc -= MASK >> 3
    for j in range(2, -1, -1):
        acc += j << 4
    ecu.x[0] = clamp(rsh(acc, cal.shift), -1000, 1000)
    ecu.small = byte((ecu.bytes[3] >> 4) & 7)
    ecu.small |= 1
    step: i32 = narrow(clamp(k, 0, 50) - 25)
    if step < 0:
        step += 25
    ecu.count = step
    return inner(ecu, ecu.m[1], sat32(k * MASK))
'''


@pytest.fixture
def good(sample):
    return emit.emit("sample", sample.write(GOOD))


def test_c_reads_like_the_source(sample, good):
    c = good["canroll_sample.c"]
    assert "/* Return a sum, with k. */" in c
    assert "    /* of the row */\n    row[0] = canroll_clamp(" in c
    assert "/* first */" in c
    assert "acc += (int64_t)cal->gain[j] * ecu->x[j];" in c
    assert "for (int32_t j = 2; j > -1; j--) {" in c
    assert "if (((int32_t)ecu->count > 3) && ((k != 2) || (!((int32_t)ecu->small == 1)))) {" in c
    assert "int32_t canroll_run(canroll_ecu *ecu, const canroll_calibration *cal, int32_t k)" in c
    assert "volatile uint8_t bytes[8]; /* mailbox */" in good["canroll_state.h"]
    assert "/* counters */" in good["canroll_state.h"]
    assert "x[3]; /* position, m Q4 */" in good["canroll_state.h"]


def test_arithmetic_is_32_bits_where_it_fits(sample):
    text = "a: i32 = ecu.x[0] * ecu.x[1] + ecu.count\n    return a * a\n"
    text = f"def run(ecu: Ecu) -> i64:\n    {text}"
    c = emit.emit("sample", sample.write(text))["canroll_sample.c"]
    assert "int32_t a = (ecu->x[0] * ecu->x[1]) + (int32_t)ecu->count;" in c
    assert "return (int64_t)a * a;" in c


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_gcc_has_nothing_to_say(tmp_path, good):
    check(tmp_path, good)


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_gcc_has_nothing_to_say_of_the_firmware(tmp_path):
    files = emit.emit()
    check(tmp_path, files)
    for text in files.values():
        assert text.isascii()
        assert max(map(len, text.splitlines())) <= 104


def check(tmp_path, files):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    sources = [str(path) for path in tmp_path.glob("*.c")]
    out = str(tmp_path / "all.o")
    command = ["gcc", *WARNINGS, "-r", "-nostdlib", "-o", out, *sources]
    result = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
    assert result.returncode == 0, result.stderr
    symbols = subprocess.run(["nm", out], capture_output=True, text=True, check=True).stdout
    for line in symbols.splitlines():
        kind, name = line.split()[-2:]
        assert kind not in "bBdDcC", f"{name}: the firmware keeps no state of its own"
        assert kind != "U" or name in COMPILERS_OWN, f"{name}: no library is called"
        assert kind not in "TR" or name.startswith("canroll_"), name


def test_a_table_stands_in_the_one_function_that_uses_it(sample):
    text = "# of a wheel\nSIGN: tuple[i32, ...] = (1, -1)\n\n\ndef run(ecu: Ecu) -> i32:\n"
    text += "    return SIGN[clamp(ecu.x[0], 0, 1)]\n"
    c = emit.emit("sample", sample.write(text))["canroll_sample.c"]
    body = c[c.index("int32_t canroll_run(") :]
    assert "    /* of a wheel */\n    static const int32_t canroll_sample_sign[2] = {\n" in body
    assert c.count("canroll_sample_sign[2]") == 1


def test_a_table_that_no_function_uses_is_left_out(sample):
    text = "USED: tuple[i32, ...] = (4, 5)\nIDLE: tuple[i32, ...] = (6, 7)\n\n\n"
    text += "def run(ecu: Ecu) -> i32:\n    return USED[clamp(ecu.x[0], 0, 1)]\n"
    c = emit.emit("sample", sample.write(text))["canroll_sample.c"]
    assert "canroll_sample_used[2]" in c
    assert "idle" not in c


def test_a_chain_of_conditions_ends_in_an_else(sample):
    text = "def run(ecu: Ecu) -> i32:\n    k: i32 = 0\n    if ecu.x[0] == 1:\n        k = 1\n"
    text += "    elif ecu.x[0] == 2:\n        k = 2\n    return k\n"
    c = emit.emit("sample", sample.write(text))["canroll_sample.c"]
    assert "        k = 2;\n    } else {\n        /* nothing to do */\n    }\n" in c


@pytest.mark.parametrize(
    "letters", ["*/", "*\\", "*``/", "*:func:/", "*??/\n/", "*éé/\n/", "*???/\n/", "**//", "/*/"]
)
def test_no_text_ends_a_comment(letters):
    """Not by a trigraph either, which C99 puts a backslash for, nor by a line that it joins."""
    seen = plain(f"a {letters} b {letters} c").replace("??/", "\\").replace("\\\n", "")
    assert "*/" not in seen and "/*" not in seen


def unsigned(sample, body, tables=""):
    text = f"{tables}def run(ecu: Ecu) -> i32:\n    {body}"
    return emit.emit("sample", sample.write(text))["canroll_sample.c"]


def test_bits_of_unsigned_values_are_taken_without_a_sign(sample):
    table = "T: tuple[u32, ...] = (0, 0xEDB88320)\nS: tuple[u16, ...] = (0, 65535)\n\n\n"
    body = "r: u32 = to_u32(ecu.x[0]) ^ 0xFFFFFFFF\n    r = (r >> 4) ^ T[r & 1]\n"
    body += "    h: u16 = S[r & 1]\n    r = r ^ h\n    return to_i32(r)\n"
    c = unsigned(sample, body, table)
    assert "uint32_t r = (uint32_t)ecu->x[0] ^ 4294967295u;" in c
    assert "r = (r >> 4u) ^ canroll_sample_t[r & 1u];" in c
    assert "0u, 3988292384u," in c
    assert "static const uint16_t canroll_sample_s[2] = {" in c
    assert "r = r ^ (uint32_t)h;" in c
    assert "return canroll_to_i32(r);" in c


@pytest.mark.parametrize(
    "body", ["r: u32 = ecu.x[0]\n    return 0\n", "r: u16 = ecu.count * 1000\n    return 0\n"]
)
def test_what_may_not_fit_an_unsigned_type_is_refused(sample, body):
    with pytest.raises(SubsetError, match=r"may not fit u(16|32): use clamp"):
        unsigned(sample, body)


def test_a_loop_without_a_counter_has_a_name_that_is_no_local(sample):
    body = "turn: i32 = 5\n    for _ in range(3):\n        turn += turn\n    return 0\n"
    c = unsigned(sample, body)
    assert "for (int32_t turn1 = 0; turn1 < 3; turn1++) {" in c


def test_what_is_never_run_has_its_c_too(sample):
    body = "sum: i32 = 0\n    for k in range(4, 3):\n        sum += k * ecu.x[0]\n    return sum\n"
    assert "sum += k * ecu->x[0];" in unsigned(sample, body)


def test_a_shift_that_may_exceed_32_bits_is_done_in_64(sample):
    sample.write(
        """
        def run(ecu: Ecu, cal: Calibration, k: i32) -> None:
            small: i32 = clamp(k, -8, 7)
            ecu.x[0] = clamp(rsh(small, cal.shift), -8, 7)
            ecu.x[1] = clamp(rsh(small, 52), -8, 7)
            ecu.x[2] = clamp(rsh(small, 31), -8, 7)
            negative: i32 = clamp(k, -8, -1)
            ecu.m[1][0] = clamp(rsh(negative, 32), -8, 7)
            ecu.small = byte((ecu.small << 40) >> 40)
            ecu.count = clamp(ecu.count >> 33, 0, 100)
            bits: u32 = to_u32(clamp(k, 0, 0))
            ecu.m[0][0] = clamp(bits << 35, 0, 0)
        """
    )
    text = emit.emit("sample", sample.path)["canroll_sample.c"]
    assert "canroll_rsh_by(small, cal->shift)" in text
    assert "canroll_rsh(small, 52)" in text
    assert "canroll_rsh32(small, 31)" in text
    assert "canroll_rsh(negative, 32)" in text
    assert "* ((int64_t)1 << 40)) >> 40" in text
    assert "(int64_t)ecu->count >> 33" in text
    assert "* ((int64_t)1 << 35)" in text


SERVICE = """
'''A service beside the loop.'''
from canroll.firmware.state import Ecu
from canroll.firmware.subset import clamp, i32


def tick(ecu: Ecu, by: i32) -> None:
    '''Count.'''
    ecu.count = clamp(ecu.count + clamp(by, -3, 3), 0, 90)
"""


def test_a_service_has_entry_points_of_its_own(sample):
    folder = sample.write("def tick(ecu: Ecu) -> None:\n    ecu.count = 1")
    (folder / "services").mkdir()
    (folder / "services" / "counter.py").write_text(SERVICE)
    files = emit.emit("sample", folder, ["counter"])
    header = files["canroll_counter.h"]
    assert "void canroll_counter_tick(canroll_ecu *ecu, int32_t by);" in header
    assert "void canroll_tick(canroll_ecu *ecu)" in files["canroll_sample.c"]
    assert '#include "canroll_counter.h"' in files["canroll.h"]
    assert "counter" not in "".join(emit.emit("sample", folder))
