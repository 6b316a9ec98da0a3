"""What the front share does to the 14-DOF car, beside the split of the static load."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from canroll.gain_gen.calibration.record import identify
from canroll.gain_gen.calibration.vehicle_part import moment_limit
from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import peak
from canroll.setup.controller import task_of

CHOICES = {"vehicle": "van_real", "law": "plain_feedforward", "actuator": "bars"}
GAIN = 2.0
"""On the law's moment, so that the bars reach their limit."""


def split(controller, share, limit):
    """Return the controller with another front share and the reach that goes with it."""
    record = copy(controller.record)
    points = len(record.schedule_gain)
    record.schedule_gain = [round(GAIN * gain) for gain in record.schedule_gain]
    record.schedule_front_share = [round(share * 2**30)] * points
    record.moment_max = round(limit * 2**14)
    return replace(controller, record=identify(record))


def figures(trace):
    """Return the largest sideslip and roll angle, rad."""
    signals = trace.signals
    sideslip = np.arctan2(signals["vy"], signals["vx"])
    return peak(sideslip), peak(signals["roll"])


@pytest.mark.parametrize(("scenario", "speed_kmh"), [("sine_with_dwell", 80), ("fishhook", 75)])
def test_less_sideslip_and_no_more_roll(scenario, speed_kmh):
    """At the limit the van, laden, slides in both without control: it has no yaw control."""
    settings, controller = plan(scenario, plant="nonlinear", speed_kmh=speed_kmh, **CHOICES)
    static = settings.vehicle.geometry.static_front_share
    task = task_of(CHOICES)
    own = controller.front_share(settings.speed)
    assert own > static + 0.05
    old, new = (
        figures(drive(settings, split(controller, share, moment_limit(task, share)), enabled=True))
        for share in (static, own)
    )
    passive = figures(drive(settings, controller, enabled=False))
    assert new[0] < 0.93 * old[0]
    assert new[1] < 1.01 * old[1]
    assert new[1] < 0.85 * passive[1]


@pytest.mark.parametrize("speed_kmh", [60.0, 80.0, 90.0])
def test_understeer_on_a_circle_is_the_passive_cars(speed_kmh):
    """Steering angle for the same curve, 2.8 to 6.3 m/s², within the band of the design."""
    settings, controller = plan(
        "constant_radius", plant="nonlinear", speed_kmh=speed_kmh, **CHOICES
    )
    found = []
    for enabled in (False, True):
        signals = drive(settings, controller, enabled=enabled).signals
        steady = slice(-1000, None)
        steer, lateral, speed = (float(np.mean(signals[n][steady])) for n in ("steer", "ay", "vx"))
        found.append(steer - settings.vehicle.geometry.wheelbase * lateral / speed**2)
    assert found[1] == pytest.approx(found[0], rel=0.06, abs=np.radians(0.02))
