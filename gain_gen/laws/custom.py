"""A user's own gains from a file: state feedback, or a discrete compensator."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from canroll import documents
from canroll.errors import UNREADABLE, CanrollError, reason
from gain_gen.laws.compensator import checked, scaled_states
from gain_gen.laws.state_feedback import actuator_rate, feedforward_row, observer_of
from gain_gen.models.controller import Compensator, Controller
from gain_gen.models.roll import Matrix
from gain_gen.models.task import Solution, Task

_MAT_TO_NPZ = """
import sys, numpy, scipy.io
found = scipy.io.loadmat(sys.argv[1])
numpy.savez(sys.stdout.buffer, **{k: v for k, v in found.items() if not k.startswith("__")})
"""
NAMES = ("K", "Kff", "A", "B", "C", "D", "E")


def read_matrices(path: Path) -> dict[str, Matrix]:
    """Return the matrices of a .npz, .mat or .toml file by name.

    Raises:
        CanrollError: unreadable, another suffix, an unknown name, not numeric.
    """
    if path.is_dir():
        raise CanrollError(f"cannot read matrices {path}: it is a directory")
    if not path.is_file():
        raise CanrollError(f"cannot read matrices {path}: no such file")
    try:
        if path.suffix == ".npz":
            with np.load(path) as stored:
                found = dict(stored)
        elif path.suffix == ".mat":
            found = _read_mat(path)
        elif path.suffix == ".toml":
            found = documents.toml(path)
        else:
            raise CanrollError(f"matrices {path}: give a .npz, .mat or .toml file")
        matrices = {name: np.atleast_2d(np.asarray(v, float)) for name, v in found.items()}
    except UNREADABLE as error:
        raise CanrollError(f"cannot read matrices {path}: {reason(error)}") from error
    unknown = sorted(set(matrices) - set(NAMES))
    if unknown:
        raise CanrollError(
            f"{path}: unknown matrix '{unknown[0]}', expected one of {', '.join(NAMES)}"
        )
    return matrices


def _read_mat(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Return the arrays of a .mat file, read in a process of its own.

    scipy's reader ends the process on some damaged files.
    """
    try:
        with np.load(io.BytesIO(documents.read_apart(_MAT_TO_NPZ, path))) as stored:
            return dict(stored)
    except ValueError as error:
        raise CanrollError(
            f"cannot read matrices {path}: not a .mat file that scipy can read: {reason(error)}"
        ) from error


def design_custom(task: Task) -> Solution:
    """u = −K [φ, φ'] or −K on all five observer states, or a discrete compensator at the tick.

    K is (1, 2) or (1, 5), Kff a number of u −= Kff a_y. A compensator takes
    [roll, roll rate, a_y, a_y from steering] in SI units: A (n, n), B (n, 4), C (1 or 2, n),
    D (1 or 2, 4), E (n, outputs) from the saturated output.
    """
    if not task.matrices:
        raise CanrollError("--law custom needs --matrices FILE")
    path = Path(task.matrices)
    matrices = read_matrices(path)
    if "K" in matrices:
        gain = np.ravel(matrices["K"])
        if len(gain) not in (2, 5):
            raise CanrollError(f"{path}: K has {len(gain)} entries, it must have 2 or 5")
        feedforward = float(np.ravel(matrices["Kff"])[0]) if "Kff" in matrices else 0.0
        controller = Controller(
            tick=task.tick,
            observer=observer_of(task),
            feedback=np.concatenate([gain, np.zeros(5 - len(gain))]),
            feedforward=feedforward_row(task, feedforward),
            actuator_rate=actuator_rate(task),
        )
        return Solution(controller, delay_aware=True)
    missing = [name for name in "ABCD" if name not in matrices]
    if missing:
        raise CanrollError(f"{path}: give K, or A, B, C and D; {missing[0]} is missing")
    a, b, c, d = (matrices[name] for name in "ABCD")
    e = matrices.get("E", np.zeros((len(a), len(c))))
    try:
        compensator = scaled_states(checked(Compensator(a=a, b=b, e=e, c=c, d=d)), task.tick)
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error
    controller = Controller(
        tick=task.tick,
        observer=observer_of(task),
        feedback=np.zeros(5),
        feedforward=np.zeros(5),
        compensator=compensator,
        actuator_rate=actuator_rate(task),
    )
    return Solution(controller, delay_aware=True)
