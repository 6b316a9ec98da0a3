"""From a task to a verified design."""

from dataclasses import replace
from math import isfinite

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from gain_gen.analysis.verify import verify
from gain_gen.laws import LAWS, OBSERVERS
from gain_gen.laws.state_feedback import sensor_noise
from gain_gen.models.task import Design, Task

SOFTENED = ("hinf_delay", "hinf_nodelay", "hinf_event", "hinf", "smc")
"""Laws designed without hold and actuator: detuned until the sampled loop passes every check."""
SOFTEST = 12

WITH_SHARE = ("steering_lead",)
"""Laws that are designed for a share of the roll moment."""

PRINTED = ("hinf_delay", "hinf_nodelay", "hinf_event", "lqr", "hinf", "smc")
"""Laws whose papers print gains."""


def design(law: str, task: Task) -> Design:
    """Return the verified design of ``law`` for ``task``.

    Raises:
        UnknownNameError: no such law or observer.
        CanrollError: a tick or delay that cannot be.
        VerdictError: infeasible, or a computed design failed a check: it is not to be used.
    """
    solve = LAWS[law]
    if task.observer not in OBSERVERS:
        raise UnknownNameError("observer", task.observer, OBSERVERS)
    if task.gains == "as_printed" and law not in PRINTED:
        raise CanrollError(
            f"--gains as_printed: no gains are printed for {law}, only for {', '.join(PRINTED)}"
        )
    if task.gamma_target < 0.0 or not isfinite(task.gamma_target):
        raise CanrollError(f"--gamma must be positive, got {task.gamma_target:g}")
    if task.gamma_target and law != "hinf_delay":
        raise CanrollError(f"--gamma applies to hinf_delay only: omit it for {law}")
    if task.moment_share is not None and law not in WITH_SHARE:
        raise CanrollError(
            f"--moment-share applies to {', '.join(WITH_SHARE)} only: omit it for {law}"
        )
    if not 0.001 <= task.tick <= 0.020:
        raise CanrollError(f"--tick must be 1 to 20 ms, got {1e3 * task.tick:g}")
    if not 0.0 <= task.delay.least <= task.delay.nominal <= task.delay.most:
        raise CanrollError("the delay must be at least 0 and its bounds in ascending order")
    task = replace(task, noise=sensor_noise(task.vehicle))
    answer = verify(law, task, solve(task))
    if task.gains == "as_printed":
        failing = f", fails {', '.join(answer.failures)}" if answer.failures else ""
        told = f"NOT VERIFIED: {law} with the gains as printed{failing}"
        return replace(answer, warnings=(told, *answer.warnings))
    if answer.is_verified:
        return answer
    for softness in range(1, SOFTEST if law in SOFTENED else 0):
        gentler = verify(law, task, solve(replace(task, softness=softness)))
        if gentler.is_verified:
            steps = "1 step" if softness == 1 else f"{softness} steps"
            told = (
                f"{law}: gain reduced in {steps} because the nominal design fails "
                f"{', '.join(answer.failures)} with hold and actuator in the loop"
            )
            return replace(gentler, warnings=(*gentler.warnings, told))
    raise VerdictError(_refusal(answer))


def _refusal(answer: Design) -> str:
    """Name the failed check and the remedy."""
    name, check = next(iter(answer.failures.items()))
    delay = answer.task.delay
    hint = (
        f"; the delay of {1e3 * delay.most:.0f} ms is beyond the {1e3 * answer.max_delay:.0f} ms "
        f"that the gains allow"
        if delay.most >= answer.max_delay
        else ""
    )
    return (
        f"{answer.law} for {answer.task.vehicle.name}: check {name} failed, "
        f"{check.value:.4g} against {check.limit:.4g}{hint}; nothing is written"
    )
