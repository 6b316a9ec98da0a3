"""Proof of no overflow, index out of range or division by zero, for all states and frames.

Each entry point runs on intervals (:mod:`canroll.codegen.proof.interpreter`), from any state within
the declared field ranges, any bytes in the mailboxes and any calibration that ``check`` accepts;
``check`` itself from any calibration at all. Every intermediate fits 64 bits, every store its type
and its field's range, every index its array, no divisor is zero, every shift count lies in 1 … 62.
As the field ranges are both assumed and shown, they are an invariant that holds at all times after
``init``.
"""

import ast
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from canroll.codegen.operations.intervals import Value
from canroll.codegen.proof.interpreter import Finding, Interpreter
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import Function, Program

ENTRIES = ("init", "receive", "tick")
CHECK = ("check", "check")


@dataclass(frozen=True, slots=True)
class Proof:
    """Result of a proof: the obligations not met, and the interval of each expression.

    ``seen`` maps a syntax node to its interval over all ways to reach it, ``obligations``
    file and line to the number of obligations that stand there, ``turns`` a loop to the most that
    it makes.
    """

    findings: tuple[Finding, ...]
    seen: Mapping[ast.AST, Value]
    obligations: Mapping[tuple[str, int], int]
    turns: Mapping[ast.For, int]


def entry_points(program: Program) -> list[Function]:
    """``init``, ``receive``, ``tick`` of each entry module, or all its functions without those."""
    return [function for name in program.entries for function in entries_of(program, name)]


def entries_of(program: Program, module: str) -> list[Function]:
    """The same of one entry module."""
    its = program.modules[module]
    known = (program.lookup(its, ast.Name(name)) for name in ENTRIES)
    found = [function for function in known if isinstance(function, Function)]
    return found or list(its.functions.values())


def prove(
    program: Program | None = None,
    *,
    calibration: Mapping[tuple[str, tuple[int, ...]], int] | None = None,
    bounded: str = "",
) -> Proof:
    """Prove ``program`` (the firmware), for all calibrations or for the one given.

    ``calibration`` maps field name and indices to the stored integer; ``bounded`` names a module
    whose loops in each other are limited.

    Raises:
        SubsetError: loops of the bounded module exceed their limit.
    """
    program = program or load()
    loose = any_calibration(program)
    strict = Interpreter(program, calibration=calibration, bounded=bounded)
    for function in entry_points(program):
        strict.run(function)
    findings = dict.fromkeys([*loose.findings, *strict.findings])
    places = loose.obligations | strict.obligations
    obligations = Counter((path, line) for path, line, _, _ in places)
    strict.add(loose)
    return Proof(tuple(findings), strict.seen, obligations, strict.turns)


def any_calibration(program: Program) -> Interpreter:
    """Run the check of calibrations, where there is one, on any calibration at all."""
    run = Interpreter(program, any_calibration=True)
    home = program.modules.get(CHECK[0])
    if home is not None and CHECK[1] in home.functions:
        run.run(home.functions[CHECK[1]])
    return run
