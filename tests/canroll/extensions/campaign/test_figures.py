"""The figures of many pairs of runs are those of the runs themselves."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from canroll.extensions.campaign.figures import FIGURES, NEEDED, figures, without_control
from canroll.firmware.state import SAFE
from canroll.runs import experiment
from canroll.studies import variation

SPREAD = variation.DEFAULT_SPREAD


def test_each_row_has_the_figures_of_its_pair():
    nominal, controller = experiment.plan("double_lane_change", law="lqr")
    faults = ("Imu.RollRate=invalid@1",)
    settings = [variation.draw(nominal, i, spread=SPREAD, seed=0) for i in range(2)]
    settings.append(replace(settings[1], faults=faults, bus="gateway_20ms"))
    rows = figures(controller, settings)
    assert rows.dtype == FIGURES
    for row, each in zip(rows, settings, strict=True):
        result = experiment.simulate(each, controller)
        for side, its in (
            ("passive", result.passive_metrics),
            ("controlled", result.controlled_metrics),
        ):
            assert dict(zip(row[side].dtype.names, row[side].tolist(), strict=True)) == asdict(its)
        assert row["safe"] == np.mean(result.controlled.ticks["mode"] == SAFE)
        assert row["cycle_hz"] == 0.0
    assert rows["safe"][2] > 0.5 > rows["safe"][1]


def test_limit_cycles_are_counted():
    nominal, controller = experiment.plan(
        "double_lane_change", law="hinf_delay", gains="theorem", unverified=True, actuator="bars"
    )
    settings = replace(nominal, bus="gateway_50ms")
    (row,) = figures(controller, [settings])
    cycle = experiment.simulate(settings, controller).limit_cycle
    assert cycle is not None
    assert (row["cycle_hz"], row["cycle_nm"]) == (cycle.frequency, cycle.amplitude)


ROLLS_OVER = {"scenario": "fishhook", "options": (("friction", 1.4),)}
WITHOUT = {
    "nominal": {"faults": ("Imu.RollRate=invalid@1",)},
    "roll1": {"plant": "roll1"},
    "linear_car": {"plant": "linear_car", "conditions": (("supply", 10.0),)},
    "bumps": {"scenario": "bumps"},
    "rollover": {**ROLLS_OVER, "speed": 120 / 3.6},
    "rollover_with_phase": {**ROLLS_OVER, "speed": 111 / 3.6, "phase": 1.3e-3},
    "rollover_just_at_a_tick": {**ROLLS_OVER, "speed": 107 / 3.6},
}


@pytest.mark.parametrize("actuator", ["suspension", "dampers", "valves"])
@pytest.mark.parametrize("change", WITHOUT.values(), ids=WITHOUT)
def test_without_control_the_plant_alone_is_the_whole_world(planned, actuator, change):
    nominal, controller = planned[actuator]
    if actuator == "valves" and change.get("plant") in {"roll1", None}:
        change = {**change, "plant": "linear_car"}
    settings = replace(nominal, **change)
    whole = experiment.drive(replace(settings, faults=()), controller, enabled=False)
    found = without_control(settings, controller)
    assert found.duration == whole.duration
    for name in NEEDED.signals:
        # a moment of -0.0 is none
        np.testing.assert_array_equal(found.signals[name], whole.signals[name], strict=True)


@pytest.fixture(scope="module")
def planned():
    law = {"suspension": "lqr", "dampers": "lqr", "valves": "lqr_full_car"}
    return {
        actuator: experiment.plan("double_lane_change", law=its, actuator=actuator, tick_ms=5.0)
        if actuator == "dampers"
        else experiment.plan(
            "double_lane_change",
            law=its,
            actuator=actuator,
            plant="linear_car" if actuator == "valves" else "nonlinear",
        )
        for actuator, its in law.items()
    }
