"""The control laws, one family per module, and their names."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.gain_gen.models.task import Solution, Task

OBSERVERS = (
    *("two_sensors", "one_sensor", "steering", "propagated"),
    *("acceleration", "acceleration_propagated", "reference"),
)
WITHOUT_ROLL_RATE = ("acceleration", "acceleration_propagated")
"""Observers for a car whose bus carries no roll rate."""

LAWS: "Registry[Callable[[Task], Solution]]" = Registry(
    "law",
    "canroll.laws",
    {
        "steering_lead": "canroll.gain_gen.laws.steering_lead:design_steering_lead",
        "lqg_delay": "canroll.gain_gen.output_feedback.law:design_lqg_delay",
        "hinf_delay": "canroll.gain_gen.laws.hinf_delay:design_hinf_delay",
        "hinf_nodelay": "canroll.gain_gen.laws.roll_rate_feedback:design_hinf_nodelay",
        "hinf_event": "canroll.gain_gen.laws.hinf_event:design_hinf_event",
        "lqr": "canroll.gain_gen.laws.state_feedback:design_lqr",
        "hinf": "canroll.gain_gen.output_feedback.law:design_hinf",
        "smc": "canroll.gain_gen.laws.state_feedback:design_smc",
        "ay_feedforward": "canroll.gain_gen.laws.state_feedback:design_ay_feedforward",
        "plain_feedforward": "canroll.gain_gen.laws.state_feedback:design_plain_feedforward",
        "rate_feedforward": "canroll.gain_gen.laws.roll_rate_feedback:design_rate_feedforward",
        "lqr_full_car": "canroll.gain_gen.laws.lqr_full_car:design_lqr_full_car",
        "custom": "canroll.gain_gen.laws.custom:design_custom",
    },
    accept="canroll.gain_gen.laws.offered:accept",
)


def is_of_user(law: str, task: "Task") -> bool:
    """Whether a design depends on code or a file of the user, which may change."""
    return bool(task.matrices) or (law in LAWS and not LAWS.origin(law).is_built_in)
