"""What an attack did, from a trace; and the attacks are ones that the language of faults knows."""

import numpy as np
import pytest

from hil.runs.trace import TICK, Trace
from hil.studies import attacks
from plant_sim.faults import language


def trace(**signals):
    """A second of a turn to the left, with a steady moment."""
    zero = np.zeros(1000)
    shown = {"moment_front": zero, "moment_rear": zero, "ay": zero + 3.0, "roll": zero - 0.02}
    shown |= {"envelope": zero, **signals}
    ticks = np.zeros(100, TICK)
    ticks["fault_codes"][40:50] = 1 << 23 | 1 << 15
    return Trace(shown, np.zeros(0), np.zeros(0, np.int64), ticks, 1.0)


def test_only_a_moment_outward_counts():
    front = np.full(1000, -900.0)
    front[200:500] = 700.0
    found = attacks.outcome("one", trace(moment_front=front))
    assert found.outward == pytest.approx(700.0)
    assert found.seconds == pytest.approx(0.3)
    assert found.roll == pytest.approx(np.degrees(0.02))
    assert found.codes == (15, 23)


@pytest.mark.parametrize(("ay", "seconds"), [(-3.0, 0.0), (0.9, 0.0), (1.1, 1.0)])
def test_the_side_is_that_of_the_acceleration(ay, seconds):
    its = trace(moment_rear=np.full(1000, 600.0), ay=np.full(1000, ay))
    assert attacks.outcome("one", its).seconds == pytest.approx(seconds)


def test_the_time_for_which_the_actuators_refuse_is_told():
    refused = np.zeros(1000)
    refused[:250] = 1.0
    assert attacks.outcome("one", trace(envelope=refused)).refused == pytest.approx(0.25)


@pytest.mark.parametrize(("name", "faults"), attacks.ATTACKS)
def test_every_attack_can_be_said(name, faults):
    assert all(language.parse(text) for text in faults), name
