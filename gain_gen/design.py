"""Verified design of a law for a task."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

from canroll import vehicles
from canroll.arguments import checked
from canroll.build_cache import kept
from canroll.errors import CanrollError, UnknownNameError, VerdictError
from canroll.gain_gen.analysis.family import Family, FamilyRow, family_of
from canroll.gain_gen.analysis.fitted_family import with_draws
from canroll.gain_gen.analysis.speed_schedule import UNLIMITED, Speeds, scheduled, speeds_of
from canroll.gain_gen.analysis.verify import holds, verify
from canroll.gain_gen.laws import LAWS, OBSERVERS, WITHOUT_ROLL_RATE, is_of_user
from canroll.gain_gen.laws.declared import COMPUTED, Declared, built_in, declared
from canroll.gain_gen.laws.roll_rate_feedback import static_controller
from canroll.gain_gen.laws.state_feedback import sensor_noise
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.task import (
    UNVERIFIED,
    Check,
    Delay,
    Design,
    Solution,
    Task,
    in_words,
    made_of,
)
from canroll.vehicles import Vehicle

STEP_DB = 1.0
"""Reduction of the whole command per step of detuning, dB."""
STEPS = 40
"""Number of steps after which a law is refused."""

UNOBSERVED = ("two_sensors", "reference")
"""The default, and what replaces the sensors: these make sense to a law without an observer."""


@checked
def design(
    law: str,
    task: Task | None = None,
    *,
    vehicle: Vehicle | Mapping[str, Any] | Path | str | None = None,
    delay: Delay | None = None,
) -> Design:
    """Return the verified design of ``law`` for ``task``, or for ``vehicle`` and ``delay``.

    A built-in law whose loop fails a check on the family of cars is detuned step by step, with a
    note. A law of the user, from a file or in Python, and the gains of a paper are never changed:
    they are refused, or marked where the task takes unverified ones. The design of a built-in law
    is made once and kept, see :mod:`canroll.build_cache`.

    Args:
        law: its name.
        task: what it is designed for.
        vehicle: instead of a task, for one with its defaults: a vehicle, file, preset or table.
        delay: with ``vehicle``, from sample to force, s.

    Raises:
        UnknownNameError: no such law, observer or vehicle.
        CanrollError: an invalid vehicle, tick or delay; neither or both of task and vehicle.
        VerdictError: infeasible, or a check failed and the task takes no unverified design.
    """
    if task is None and vehicle is not None and delay is not None:
        task = Task(vehicles.load(vehicle), delay)
    elif task is None or vehicle is not None or delay is not None:
        raise CanrollError("design needs a task, or else vehicle and delay")
    if is_of_user(law, task):
        return _designed(law, task)
    return kept("designs", made_of(law, task), lambda: _designed(law, task))


def _designed(law: str, task: Task) -> Design:
    """Return the verified design of a law for a task."""
    solve = LAWS[law]
    if task.observer not in OBSERVERS:
        raise UnknownNameError("observer", task.observer, OBSERVERS)
    of = declared(solve)
    for refusal in _refusals(law, of, task):
        raise CanrollError(refusal)
    if not 0.001 <= task.tick <= 0.020:
        raise CanrollError(f"--tick must be 1 to 20 ms, got {1e3 * task.tick:g}")
    if not 0.0 <= task.delay.least <= task.delay.nominal <= task.delay.most:
        raise CanrollError("the delay must be at least 0 and its bounds in ascending order")
    task = replace(task, noise=sensor_noise(task.vehicle))
    family = with_draws(family_of(task), task)
    first = solve(task)
    if task.observer in WITHOUT_ROLL_RATE:
        if first.controller.reads_roll_rate:
            raise CanrollError(
                f"--observer {task.observer}: {law} reads the measured roll rate, which this "
                "observer does without; choose a law on the observed state such as lqr"
            )
    elif task.observer not in UNOBSERVED and not first.controller.observes:
        raise CanrollError(
            f"--observer {task.observer}: {law} uses the sensors as they are, not the observer; "
            f"omit it, or choose a law on the observed state such as lqr"
        )
    if not task.feedforward and first.controller.compensator is not None:
        raise CanrollError(
            f"--no-feedforward: {law} has one compensator for all and no feedforward apart; omit it"
        )
    of_user = of.matrices or not LAWS.origin(law).is_built_in
    own = task.gains != COMPUTED or of_user
    speeds = None if own or first.verified_by_law or family.note else speeds_of(task)
    limits = UNLIMITED if speeds is None else speeds.limits(first.controller)
    designed = replace(first, controller=scheduled(first.controller, limits, 1.0))
    answer = verify(law, task, designed, family, speeds)
    if answer.is_verified:
        return answer
    if task.unverified and (own or first.verified_by_law):
        return _marked(answer)
    # a law that verifies itself holds on its own car alone
    detuned = None if first.verified_by_law else _detuned(first, answer, family, speeds, limits)
    if detuned is not None and not own:
        reduction, gentler = detuned
        cause = in_words(*_first_failure(answer))
        note = f"command reduced by {reduction:g} dB; as designed its {cause}"
        return replace(gentler, warnings=(*gentler.warnings, note))
    if task.unverified:
        return _marked(answer)
    raise VerdictError(_refusal(answer, None if detuned is None else detuned[0]))


def _refusals(law: str, of: Declared, task: Task) -> Iterator[str]:
    """Yield the options of a task that a law does not take."""
    if task.gains not in of.gains:
        having = built_in(lambda other: task.gains in other.gains)
        yield f"--gains {task.gains}: {law} has none, only {', '.join(having)}"
    if task.gamma_target < 0.0 or not isfinite(task.gamma_target):
        yield f"--gamma must be positive, got {task.gamma_target:g}"
    if task.gamma_target and not (of.level and task.gains == "theorem"):
        having = built_in(lambda other: other.level)
        yield f"--gamma applies to --law {', '.join(having)} --gains theorem only: omit it"
    if not task.feedforward and of.feedforward == "none":
        yield f"--no-feedforward: {law} has none; omit it"
    if not task.feedforward and of.feedforward == "alone":
        yield f"--no-feedforward: {law} is nothing else; omit it"
    if task.moment_share is not None and not of.share:
        having = built_in(lambda other: other.share)
        yield f"--moment-share applies to {', '.join(having)} only: omit it for {law}"
    if task.matrices and not of.matrices:
        having = built_in(lambda other: other.matrices)
        yield f"--matrices applies to --law {', '.join(having)} only: omit it for {law}"


def without_control(task: Task) -> Design:
    """Return gains of zero for ``task``: nothing is designed and nothing verified."""
    task = replace(task, noise=sensor_noise(task.vehicle))
    return Design("passive", task, Solution(static_controller(task, 0.0)), {}, {})


def _detuned(
    first: Solution,
    answer: Design,
    family: Family,
    speeds: Speeds | None,
    limits: tuple[float, ...],
) -> tuple[float, Design] | None:
    """Return the strongest verified design with its command scaled down, and by how many dB."""
    failed: FamilyRow | None = None
    for step in range(1, STEPS + 1):
        controller = scheduled(first.controller, limits, 10.0 ** (-STEP_DB * step / 20.0))
        rows = family.rows(controller, first=failed)
        failed = next((row for row in rows if not holds(row)), None)
        if failed is not None:
            continue
        # what the law certifies is about the gain before it was scaled
        gentler = _uncertified(first, controller)
        verified = verify(answer.law, answer.task, gentler, family, speeds)
        if verified.is_verified:
            return STEP_DB * step, verified
    return None


def _uncertified(first: Solution, controller: LinearController) -> Solution:
    """Return the solution with another controller and without the law's own certificates."""
    return replace(
        first,
        controller=controller,
        gamma=None,
        gamma_bound=None,
        gamma_channel="",
        checks={},
        rightmost_root=None,
        max_delay=None,
    )


def _first_failure(answer: Design) -> tuple[str, Check]:
    """Return the most informative failed check: margins before what follows from them."""
    failures = answer.failures
    for name in ("gain_margin_db", "peak_sensitivity"):
        if name in failures:
            return name, failures[name]
    return next(iter(failures.items()))


def _marked(answer: Design) -> Design:
    """Return the design with the warning that it is not verified, and what it fails."""
    printed = {"as_printed": "as printed", "theorem": "of the theorem"}
    of = printed.get(answer.task.gains)
    gains = "" if of is None else f" with the gains {of}"
    failing = f": {'; '.join(answer.failed)}" if answer.failures else ""
    note = f"{UNVERIFIED}: {answer.law}{gains}{failing}"
    return replace(answer, warnings=(note, *answer.warnings))


def _refusal(answer: Design, reduction: float | None) -> str:
    """Return the error that names the failed check and the remedy.

    Args:
        answer: the design.
        reduction: of the whole command with which it passes, dB; None if there is none.
    """
    delay = answer.task.delay
    hint = (
        f"; the delay of {1e3 * delay.most:.0f} ms is beyond the {1e3 * answer.max_delay:.0f} ms "
        f"that the gains allow"
        if delay.most >= answer.max_delay
        else ""
    )
    reduced = "" if reduction is None else f"reduce the gains by {reduction:g} dB, or "
    remedy = f"{reduced}use it as it is with --unverified"
    return (
        f"{answer.law} for {answer.task.vehicle.name}: {in_words(*_first_failure(answer))}{hint}; "
        f"{remedy}"
    )
