"""A user's own gains: state feedback, or a discrete compensator."""

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from canroll import documents
from canroll.errors import UNREADABLE, CanrollError, reason
from canroll.gain_gen.laws.compensator import checked, scaled_states
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.state_feedback import controller_of, feedforward_row
from canroll.gain_gen.models.controller import Compensator
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.task import Solution, Task

MOST_NUMBERS = 1000
"""Numbers of a matrix of gains."""
MOST_MEMORY, MOST_SECONDS = 2 << 30, 60.0
"""Of the process that reads a .mat file: bytes, s."""
FEEDBACK = ("K", "Kff")
COMPENSATOR = ("A", "B", "C", "D", "E")
NAMES = (*FEEDBACK, *COMPENSATOR)
UNSTABLE = 1.0 + 1e-9
"""Magnitude of an eigenvalue above which a compensator's states grow by themselves."""


def read_matrices(path: Path) -> dict[str, Matrix]:
    """Return the matrices of a .npz, .mat or .toml file by name.

    Raises:
        CanrollError: unreadable, another suffix, or as of :func:`checked_matrices`.
    """
    if path.is_dir():
        raise CanrollError(f"cannot read matrices {path}: it is a directory")
    if not path.is_file():
        raise CanrollError(f"cannot read matrices {path}: no such file")
    try:
        if path.suffix == ".npz":
            _refuse_large(path)
            with np.load(path) as stored:
                entries = dict(stored)
        elif path.suffix == ".mat":
            entries = documents.read_mat(
                path, MOST_NUMBERS, memory=MOST_MEMORY, seconds=MOST_SECONDS
            )
        elif path.suffix == ".toml":
            entries = documents.toml(path)
        else:
            raise CanrollError(f"matrices {path}: give a .npz, .mat or .toml file")
    except UNREADABLE as error:
        raise CanrollError(f"cannot read matrices {path}: {reason(error)}") from error
    return checked_matrices(entries, str(path))


def checked_matrices(entries: Mapping[str, Any], where: str) -> dict[str, Matrix]:
    """Return matrices by name, as arrays.

    Raises:
        CanrollError: an unknown name, not finite numbers, matrices of a state feedback and of a
            compensator.
    """
    try:
        matrices = {name: np.atleast_2d(np.asarray(v, float)) for name, v in entries.items()}
    except UNREADABLE as error:
        raise CanrollError(f"cannot read matrices {where}: {reason(error)}") from error
    unknown = sorted(set(matrices) - set(NAMES))
    if unknown:
        raise CanrollError(
            f"{where}: unknown matrix '{unknown[0]}', expected one of {', '.join(NAMES)}"
        )
    for name, matrix in matrices.items():
        if not np.isfinite(matrix).all():
            raise CanrollError(f"{where}: {name} has a number that is not finite")
    kinds = [
        next((name for name in kind if name in matrices), "") for kind in (FEEDBACK, COMPENSATOR)
    ]
    if all(kinds):
        raise CanrollError(
            f"{where}: {kinds[0]} is of a state feedback, {kinds[1]} of a compensator: give "
            f"{', '.join(FEEDBACK)} or {', '.join(COMPENSATOR)}"
        )
    return matrices


def _refuse_large(path: Path) -> None:
    """Raise ValueError for an archive whose headers say that it has more than gains."""
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with archive.open(name) as file:
                if npy.read_magic(file) != (1, 0):
                    raise ValueError(f"{name}: unknown version of the .npy format")
                shape = npy.read_array_header_1_0(file)[0]
            if not 0 <= math.prod(shape) <= MOST_NUMBERS:
                raise ValueError(f"{Path(name).stem} has more than {MOST_NUMBERS} numbers")
        if len(archive.namelist()) > len(NAMES):
            raise ValueError(f"more than {len(NAMES)} matrices")


@law(matrices=True)
def design_custom(task: Task) -> Solution:
    """Your gains: u = −K [φ, φ'], −K on all five observer states, or a discrete compensator.

    K is (1, 2) or (1, 5), Kff a number of u −= Kff a_y. A compensator takes
    [roll, roll rate, a_y, a_y from steering] in SI units: A (n, n), B (n, 4), C (1 or 2, n),
    D (1 or 2, 4), E (n, outputs) from the saturated output.
    """
    if not task.matrices:
        raise CanrollError("--law custom needs its gains: add --matrices FILE")
    if isinstance(task.matrices, str):
        where, matrices = task.matrices, read_matrices(Path(task.matrices))
    else:
        where = "matrices"
        matrices = checked_matrices(task.matrices, where)
    if "K" in matrices:
        gain = np.ravel(matrices["K"])
        if len(gain) not in (2, 5):
            raise CanrollError(f"{where}: K has {len(gain)} entries, it must have 2 or 5")
        feedforward = float(np.ravel(matrices["Kff"])[0]) if "Kff" in matrices else 0.0
        controller = controller_of(
            task,
            feedback=np.concatenate([gain, np.zeros(5 - len(gain))]),
            feedforward=feedforward_row(task, feedforward),
        )
        return Solution(controller, delay_aware=True, given=matrices)
    missing = [name for name in "ABCD" if name not in matrices]
    if missing:
        raise CanrollError(f"{where}: give K, or A, B, C and D; {missing[0]} is missing")
    a, b, c, d = (matrices[name] for name in "ABCD")
    e = matrices.get("E", np.zeros((len(a), len(c))))
    try:
        given = checked(Compensator(a=a, b=b, e=e, c=c, d=d))
        _refuse_unstable(given)
        compensator = scaled_states(given, task.tick)
    except CanrollError as error:
        raise CanrollError(f"{where}: {error}") from error
    controller = controller_of(task, compensator=compensator)
    return Solution(controller, delay_aware=True, given=matrices)


def _refuse_unstable(compensator: Compensator) -> None:
    """Refuse states that grow by themselves while the output is not saturated."""
    poles = np.linalg.eigvals(compensator.a + compensator.e @ compensator.c)
    worst = poles[np.argmax(np.abs(poles))]
    if abs(worst) > UNSTABLE:
        of = "A + E C" if np.any(compensator.e) else "A"
        value = f"{worst:.4g}" if worst.imag else f"{worst.real:.4g}"
        raise CanrollError(f"{of} has an eigenvalue outside the unit circle: {value}")
