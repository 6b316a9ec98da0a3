"""The least constant fault that the monitors find in whole runs, against the design's table."""

from dataclasses import replace
from statistics import median

import numpy as np
import pytest

from canroll.gain_gen.models.task import Delay, Task
from canroll.gain_gen.monitors.detectability import TOLERATED, detectable
from canroll.gain_gen.monitors.residuals import bank_of
from canroll.gain_gen.monitors.uncertainty import DEFAULT
from canroll.runs import experiment
from canroll.vehicles import load

pytestmark = pytest.mark.slow

BEGIN = 3.0
"""When a fault begins, s; all monitors judge by then."""
SEEDS = range(5)
STEPS = 6
VEHICLE = "van_real"
LIMIT = load(VEHICLE).actuators.bars.torque_limit


def table() -> dict[str, float]:
    task = Task(load(VEHICLE), Delay.constant(0.02), actuator="bars")
    bank = bank_of(task, DEFAULT, suspension=True, moments=True)
    return {row.fault.name: row.straight for row in detectable(bank, task.vehicle)}


def least(law: str, fault: str, scale: float, theory: float) -> float:
    """Median over seeds of the least size found in time, by bisection on a straight, even road."""
    settings, controller = experiment.plan("step_steer", law=law, actuator="bars", vehicle=VEHICLE)
    duration = BEGIN + TOLERATED + 2.0 * settings.tick
    straight = np.zeros(round(1e3 * duration) + 1)

    def found(size: float, seed: int) -> bool:
        run = replace(settings, faults=(fault.format(size * scale),), seed=seed)
        ticks = experiment.drive(
            run, controller, enabled=True, duration=duration, steer=straight
        ).ticks
        assert not ticks["fault_codes"][ticks["t"] < BEGIN].any()
        return bool(ticks["fault_codes"].any())

    sizes = []
    for seed in SEEDS:
        low, high = 0.4 * theory, 2.5 * theory
        assert found(high, seed)
        for _ in range(STEPS):
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if found(middle, seed) else (middle, high)
        sizes.append(high)
    return median(sizes)


@pytest.mark.parametrize(
    ("law", "row", "fault", "scale"),
    [
        ("lqr", "moment of the front axle", "front=runaway:{:.4f}@3 + front=lying@3", 1.0 / LIMIT),
        ("lqr", "moment of the rear axle", "rear=runaway:{:.4f}@3 + rear=lying@3", 1.0 / LIMIT),
        # a law answers a wrong sensor: the body then moves, which the thresholds allow for
        ("passive", "lateral acceleration", "Imu.LateralAcceleration=offset:{:.4f}@3", 1.0),
        ("passive", "roll rate", "Imu.RollRate=offset:{:.5f}@3", 1.0),
    ],
    ids=["front moment", "rear moment", "lateral acceleration", "roll rate"],
)
def test_the_least_fault_found_is_that_of_the_table(law, row, fault, scale):
    theory = table()[row]
    ratio = least(law, fault, scale, theory) / theory
    print(f"{row}: {theory:.3g} by the table, in runs {ratio:.2f} times as much")
    assert 0.8 <= ratio <= 1.2
