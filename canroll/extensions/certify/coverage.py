"""Statements about a loop that is not proved: the delays it is proved for, and the worst ones."""

from collections.abc import Sequence
from dataclasses import dataclass

from canroll.extensions.certify.certificate import EVERY_TICK
from canroll.extensions.certify.claim import Wish, prove
from canroll.extensions.certify.delay_sequence import DelaySequence, closest, simulate
from canroll.extensions.certify.subject import INTEGERS, condition_of, resolutions
from canroll.gain_gen.analysis.family import Member
from canroll.gain_gen.analysis.sampled_loop import spectral_radius
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.models.task import Task

STEPS = 5
"""Of the bisection for the longest delay."""
ROLL = 0.01745
"""Roll angle at the start of a simulation, rad."""
SECONDS = 5.0


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A condition in which the loop is not proved stable.

    Attributes:
        member: of the family.
        most: with the least delay of the task up to this one it is proved, without the sensor's
            low-pass, s; None where not even the least delay alone is.
        sequence: periodic sequence of delays of largest growth among those tried.
        simulated: largest roll angle in the third and in the last of :data:`SECONDS` seconds under
            it, relative to that at the start.
    """

    member: Member
    most: float | None
    sequence: DelaySequence
    simulated: tuple[float, float]

    @property
    def unstable(self) -> bool:
        """Whether the sequence shows that no proof exists."""
        return self.sequence.radius >= 1.0


def least_stable(
    members: Sequence[Member], calibration: LoadedCalibration, delay: float
) -> list[Member]:
    """Return members, the one nearest to instability under a constant delay (s) first."""
    controller = dequantise(calibration.record)

    def radius(member: Member) -> float:
        return spectral_radius(member.loop(controller, delay))

    return sorted(members, key=radius, reverse=True)


def shortfall(
    member: Member, task: Task, calibration: LoadedCalibration, delay: tuple[float, float]
) -> Shortfall:
    """Return how far the proof goes in a condition, and the sequence that comes closest."""
    controller = dequantise(calibration.record)
    sequence = closest(member, controller, delay)
    ticks = round(SECONDS / task.tick)
    angles = abs(simulate(member, controller, sequence.delays, roll=ROLL, ticks=ticks)) / ROLL
    second = round(1.0 / task.tick)
    third = angles[2 * second : 3 * second]  # what decays quickly has gone
    simulated = (float(third.max()), float(angles[-second:].max()))
    return Shortfall(member, _longest(member, task, calibration, delay), sequence, simulated)


def _longest(
    member: Member, task: Task, calibration: LoadedCalibration, delay: tuple[float, float]
) -> float | None:
    """Return the longest delay up to which the condition is proved, by bisection."""
    integers = {name: getattr(calibration.record, name) for name in INTEGERS}
    condition = condition_of(member)
    resolution = resolutions(task.vehicle, calibration.record, task.resolution)

    def holds(most: float) -> bool:
        wish = Wish(EVERY_TICK, (delay[0], most), resolution)
        return prove(integers, condition, wish) is not None

    low, high = delay
    if not holds(low):
        return None
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
