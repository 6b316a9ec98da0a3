"""Verified design of a law for a task."""

from dataclasses import replace
from math import isfinite

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from gain_gen.analysis.family import Family, FamilyRow, family_of
from gain_gen.analysis.speed_schedule import UNLIMITED, Speeds, scheduled, speeds_of
from gain_gen.analysis.verify import holds, verify
from gain_gen.laws import LAWS, OBSERVERS
from gain_gen.laws.state_feedback import sensor_noise
from gain_gen.models.controller import Controller
from gain_gen.models.task import Check, Design, Solution, Task

STEP_DB = 1.0
"""Reduction of the whole command per step of detuning, dB."""
STEPS = 40
"""Number of steps after which a law is refused."""

WITHOUT_FEEDFORWARD = ("hinf_delay", "hinf_nodelay", "hinf_event", "lqr_full_car")
FEEDFORWARD_ALONE = ("ay_feedforward", "plain_feedforward")
WITH_SHARE = ("steering_lead", "lqg_delay", "hinf")
"""Laws that are designed for a share of the roll moment."""

PRINTED = ("hinf_delay", "hinf_nodelay", "hinf_event", "lqr", "hinf", "smc")
"""Laws whose papers print gains."""
THEOREMS = ("hinf_delay", "hinf_event", "hinf")
"""Laws whose papers have a theorem of their own, on a 1-DOF model."""
UNOBSERVED = ("two_sensors", "reference")
"""The default, and what replaces the sensors: these make sense to a law without an observer."""
UNITS = {"gain_margin_db": " dB", "delay_margin_s": " s"}


def design(law: str, task: Task) -> Design:
    """Return the verified design of ``law`` for ``task``.

    A design whose loop fails a check on the family of cars is detuned step by step, with a note.

    Raises:
        UnknownNameError: no such law or observer.
        CanrollError: an invalid tick or delay.
        VerdictError: infeasible, or a computed design failed a check and must not be used.
    """
    solve = LAWS[law]
    if task.observer not in OBSERVERS:
        raise UnknownNameError("observer", task.observer, OBSERVERS)
    for gains, having in {"as_printed": PRINTED, "theorem": THEOREMS}.items():
        if task.gains == gains and law not in having:
            raise CanrollError(f"--gains {gains}: {law} has none, only {', '.join(having)}")
    if task.gamma_target < 0.0 or not isfinite(task.gamma_target):
        raise CanrollError(f"--gamma must be positive, got {task.gamma_target:g}")
    if task.gamma_target and (law != "hinf_delay" or task.gains != "theorem"):
        raise CanrollError("--gamma applies to --law hinf_delay --gains theorem only: omit it")
    if not task.feedforward and law in WITHOUT_FEEDFORWARD:
        raise CanrollError(f"--no-feedforward: {law} has none; omit it")
    if not task.feedforward and law in FEEDFORWARD_ALONE:
        raise CanrollError(f"--no-feedforward: {law} is nothing else; omit it")
    if task.moment_share is not None and law not in WITH_SHARE:
        raise CanrollError(
            f"--moment-share applies to {', '.join(WITH_SHARE)} only: omit it for {law}"
        )
    if not 0.001 <= task.tick <= 0.020:
        raise CanrollError(f"--tick must be 1 to 20 ms, got {1e3 * task.tick:g}")
    if not 0.0 <= task.delay.least <= task.delay.nominal <= task.delay.most:
        raise CanrollError("the delay must be at least 0 and its bounds in ascending order")
    task = replace(task, noise=sensor_noise(task.vehicle))
    family = family_of(task)
    first = solve(task)
    if task.observer not in UNOBSERVED and not first.controller.observes:
        raise CanrollError(
            f"--observer {task.observer}: {law} uses the sensors as they are, not the observer; "
            f"omit it, or choose a law on the observed state such as lqr"
        )
    if not task.feedforward and first.controller.compensator is not None:
        raise CanrollError(
            f"--no-feedforward: {law} has one compensator for all and no feedforward apart; omit it"
        )
    own = task.gains != "computed" or law == "custom"
    speeds = None if own or first.verified_by_law or family.note else speeds_of(task)
    limits = UNLIMITED if speeds is None else speeds.limits(first.controller)
    designed = replace(first, controller=scheduled(first.controller, limits, 1.0))
    answer = verify(law, task, designed, family, speeds)
    if answer.is_verified:
        return answer
    if task.gains != "computed":
        of = {"as_printed": "as printed", "theorem": "of the theorem"}[task.gains]
        failing = f", fails {', '.join(answer.failures)}" if answer.failures else ""
        told = f"NOT VERIFIED: {law} with the gains {of}{failing}"
        return replace(answer, warnings=(told, *answer.warnings))
    if first.verified_by_law or law == "custom":
        # one holds on its own car, the other's gains are the user's
        raise VerdictError(_refusal(answer))
    detuned = _detuned(first, answer, family, speeds, limits)
    if detuned is None:
        raise VerdictError(_refusal(answer))
    told, found = detuned
    cause = _failure(*_first_failure(answer))
    return replace(found, warnings=(*found.warnings, f"{told}; as designed its {cause}"))


def _detuned(
    first: Solution,
    answer: Design,
    family: Family,
    speeds: Speeds | None,
    limits: tuple[float, ...],
) -> tuple[str, Design] | None:
    """Return the strongest verified design with its command scaled down, and the factor."""
    failed: FamilyRow | None = None
    for step in range(1, STEPS + 1):
        controller = scheduled(first.controller, limits, 10.0 ** (-STEP_DB * step / 20.0))
        rows = family.rows(controller, first=failed)
        failed = next((row for row in rows if not holds(row)), None)
        if failed is not None:
            continue
        # what the law certifies is about the gain before it was scaled
        gentler = _uncertified(first, controller)
        found = verify(answer.law, answer.task, gentler, family, speeds)
        if found.is_verified:
            return f"command reduced by {STEP_DB * step:g} dB", found
    return None


def _uncertified(first: Solution, controller: Controller) -> Solution:
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


def _failure(name: str, check: Check) -> str:
    """Describe a failed check and where it fails."""
    unit = UNITS.get(name, "")
    where = f" ({check.where})" if check.where else ""
    words = name.removesuffix("_db").removesuffix("_s").replace("_", " ")
    return f"{words} is {check.value:.3g}{unit} against {check.limit:g}{unit}{where}"


def _refusal(answer: Design) -> str:
    """Return the error that names the failed check and the remedy."""
    delay = answer.task.delay
    hint = (
        f"; the delay of {1e3 * delay.most:.0f} ms is beyond the {1e3 * answer.max_delay:.0f} ms "
        f"that the gains allow"
        if delay.most >= answer.max_delay
        else ""
    )
    return (
        f"{answer.law} for {answer.task.vehicle.name}: {_failure(*_first_failure(answer))}{hint}; "
        "nothing is written"
    )
