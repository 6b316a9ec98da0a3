"""Laws of the papers on the 14-DOF car: none oscillates where their printed designs did."""

import pytest
from support.limit_cycles import detect

from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import judge

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("law", ["lqr", "hinf", "smc", "lqg_delay", "steering_lead"])
@pytest.mark.parametrize("bus", ["500k", "gateway_50ms"])
def test_a_small_suv_with_bars_on_a_wet_road_does_not_oscillate(law, bus):
    settings, controller = plan(
        "double_lane_change",
        vehicle="suv_2020",
        actuator="bars",
        law=law,
        bus=bus,
        plant="nonlinear",
        options={"friction": 0.6},
    )
    passive, found = (drive(settings, controller, enabled=enabled) for enabled in (False, True))
    roll = passive.signals["time"], passive.signals["roll"]
    assert detect(found.ticks["t"], found.ticks["moment"], *roll) is None
    assert judge(found).roll_rms_deg < 0.95 * judge(passive).roll_rms_deg
