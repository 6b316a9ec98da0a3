"""Random programs: what rules accept and the proof passes is the same in CPython and in C.

Every value that CPython meets lies in its proved interval, every field in its declared range; no
compiler at any level, and no sanitizer, sees anything else.
"""

import ast
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from support.programs import programs

from canroll.codegen.c99 import emit
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import cortex, memory_image
from canroll.codegen.subset import rules
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import SubsetError
from canroll.firmware.subset import fields

MAIN = """
#include "canroll.h"
#include <stdio.h>

static canroll_s one, two;

int main(void)
{
    uint8_t p[4];
    int32_t v[2], result;
    while (fread(&one, sizeof one, 1, stdin) == 1 && fread(&two, sizeof two, 1, stdin) == 1
           && fread(p, sizeof p, 1, stdin) == 1 && fread(v, sizeof v, 1, stdin) == 1) {
        result = canroll_tick(&one, &two, p, v[0], v[1]);
        fwrite(&one, sizeof one, 1, stdout);
        fwrite(&two, sizeof two, 1, stdout);
        fwrite(p, sizeof p, 1, stdout);
        fwrite(&result, sizeof result, 1, stdout);
    }
    return 0;
}
"""
CLANG = [sys.executable, "-m", "ziglang", "cc"]
CHECKED = ["-O1", "-fsanitize=undefined,bounds", "-fno-sanitize-recover=all"]
BUILDS = {
    "gcc -O0": ["gcc", "-O0"],
    "gcc -O2": ["gcc", "-O2"],
    "gcc with sanitizers": ["gcc", *CHECKED],
    "clang -O0": [*CLANG, "-O0", "-fno-sanitize=undefined"],
    "clang -O2": [*CLANG, "-O2", "-fno-sanitize=undefined"],
}
I32 = (-(1 << 31), (1 << 31) - 1)


class Watch(ast.NodeTransformer):
    """Has every expression with a proved interval looked at as it is computed."""

    def __init__(self, seen):
        self.seen = {at(node): value for node, value in seen.items() if isinstance(node, ast.expr)}

    def visit(self, node):
        interval = self.seen.get(at(node)) if isinstance(node, ast.expr) else None
        node = self.generic_visit(node)
        if interval is None or not isinstance(getattr(node, "ctx", ast.Load()), ast.Load):
            return node
        limits = [ast.Constant(n) for n in (interval.lo, interval.hi, node.lineno)]
        call = ast.Call(ast.Name("look", ast.Load()), [node, *limits], [])
        return ast.copy_location(call, node)


def at(node):
    ends = node.lineno, node.col_offset, node.end_lineno, node.end_col_offset
    return type(node).__name__, *ends


class Watched:
    """A program in CPython; ``operations`` are the values that were looked at."""

    def __init__(self, text, seen):
        self.operations = 0
        tree = ast.fix_missing_locations(Watch(seen).visit(ast.parse(text)))
        self.names = {"look": self._look, "__name__": "random_program"}
        exec(compile(tree, "program", "exec"), self.names)

    def _look(self, value, lo, hi, line):
        self.operations += 1
        assert lo <= value <= hi, f"line {line}: {value} outside [{lo}, {hi}]"
        return value

    def run(self, one, two, payload, numbers):
        """Bytes after a call, as the C program writes them."""
        result = self.names["tick"](one, two, payload, *numbers)
        for record in (one, two):
            for field in fields(type(record)):
                values = np.ravel(getattr(record, field.name))
                assert field.f.lo <= values.min() <= values.max() <= field.f.hi, field.name
        return packed(one, two, payload, result)


def packed(one, two, payload, *numbers):
    images = memory_image.image(one) + memory_image.image(two)
    return images + bytes(payload) + np.array(numbers, "<i4").tobytes()


def number(rng, lo, hi):
    corners = [n for n in (lo, hi, 0, 1, -1, 3, 4) if lo <= n <= hi]
    return rng.choice([*corners, rng.randint(lo, hi), min(max(rng.randint(-9, 9), lo), hi)])


def record(rng, kind):
    made = kind()
    for field in fields(kind):
        values = [number(rng, field.f.lo, field.f.hi) for _ in range(*field.shape or (1,))]
        setattr(made, field.name, values if field.shape else values[0])
    return made


def accepted(folder, text):
    """The proof and the C of a program; None where it is refused."""
    (folder / "ecu.py").write_text(text)
    try:
        program = load("ecu", folder)
        rules.check(program)
        proof = prove(program)
        return None if proof.findings else (proof, emit.emit("ecu", folder))
    except SubsetError:
        return None


def compared(text, builds, inputs):
    """Run a program everywhere; return how many operations CPython did, 0 where it is refused."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if (result := accepted(folder, text)) is None:
            return 0
        proof, files = result
        watched, rng = Watched(text, proof.seen), random.Random(0)
        given, wanted = [], []
        for _ in range(inputs):
            one, two = (record(rng, watched.names["S"]) for _ in range(2))
            payload = [number(rng, 0, 255) for _ in range(4)]
            numbers = [number(rng, *I32) for _ in range(2)]
            given.append(packed(one, two, payload, *numbers))
            wanted.append(watched.run(one, two, payload, numbers))
        for name, source in (files | {"main.c": MAIN}).items():
            (folder / name).write_text(source)
        for name in builds:
            command = [*BUILDS[name], "-std=c99", "-w", "-o", "program"]
            command += [path.name for path in folder.glob("*.c")]
            subprocess.run(command, cwd=folder, check=True)
            run = [folder / "program"]
            done = subprocess.run(run, input=b"".join(given), capture_output=True, check=False)
            assert (done.returncode, done.stderr) == (0, b""), name
            assert done.stdout == b"".join(wanted), name
        return watched.operations


def available():
    names = ["gcc -O0", "gcc -O2", "gcc with sanitizers"]
    return names + (["clang -O0", "clang -O2"] if cortex.has_pip_tools() else [])


def check(examples, builds, inputs):
    """Compare random programs; return how many were accepted, and their operations."""
    done = []

    @settings(max_examples=examples, suppress_health_check=list(HealthCheck))
    @given(programs())
    def compare(text):
        done.append(compared(text, builds, inputs))

    compare()
    return sum(map(bool, done)), sum(done)


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_accepted_programs_are_the_same_in_c_and_in_bounds():
    kept, operations = check(12, ["gcc with sanitizers"], 24)
    assert kept > 3
    assert operations > 1000


@pytest.mark.long
@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_a_million_operations_are_the_same_in_c_and_in_bounds():
    kept, operations = check(700, available(), 400)
    assert kept > 100
    assert operations > 1_000_000
