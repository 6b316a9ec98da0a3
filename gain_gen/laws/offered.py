"""Laws of extensions: their solutions are checked before use."""

from collections.abc import Callable
from functools import wraps

import numpy as np

from canroll.errors import CanrollError
from canroll.extension import guarded
from canroll.firmware.calibration import N_RING
from canroll.gain_gen.laws.compensator import checked
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.observer import Observer
from canroll.gain_gen.models.task import Solution, Task


def accept(what: str, law: Callable[[Task], Solution]) -> Callable[[Task], Solution]:
    """Wrap an extension's law so that its errors and solutions are checked.

    Args:
        what: kind of object, for error messages.
        law: a function from a task to a solution.

    Raises:
        CanrollError: it cannot be called with one task.
    """
    solve = guarded(what, law, 1, Solution)

    @wraps(law)
    def call(task: Task) -> Solution:
        solution = solve(task)
        try:
            check_controller(solution.controller, task)
        except CanrollError as error:
            raise CanrollError(f"{what}: {error}") from error
        return solution

    return call


def check_controller(controller: LinearController, task: Task) -> None:
    """Refuse a controller with shapes or numbers that the ECU cannot hold.

    Raises:
        CanrollError: the message names the fault.
    """
    if not isinstance(controller, LinearController) or not isinstance(
        controller.observer, Observer
    ):
        raise CanrollError("its controller must be a LinearController with an Observer")
    rows = {"feedback": 5, "feedforward": 5, "output_gain": 3}
    for name, length in rows.items():
        row = getattr(controller, name)
        if name == "output_gain" and row is None:
            continue
        if np.shape(row) != (length,):
            raise CanrollError(f"{name} has the shape {np.shape(row)}, it must be ({length},)")
        if not np.all(np.isfinite(row)):
            raise CanrollError(f"{name} is not finite")
    if controller.compensator is not None:
        checked(controller.compensator)
    if controller.tick != task.tick:
        raise CanrollError(f"a tick of {controller.tick:g} s, its task has {task.tick:g} s")
    if not 0 <= controller.predict_steps <= N_RING:
        raise CanrollError(f"predict_steps {controller.predict_steps}: it must be 0 to {N_RING}")
    if not 0.0 <= controller.actuator_rate <= 1.0:
        raise CanrollError(f"actuator_rate {controller.actuator_rate:g}: it must be 0 to 1")
