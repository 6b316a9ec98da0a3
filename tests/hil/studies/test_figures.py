"""The figures of many pairs of runs are those of the runs themselves."""

from dataclasses import asdict, replace

import numpy as np

from firmware.state import SAFE
from hil.runs import experiment
from hil.studies import variation
from hil.studies.figures import FIGURES, figures

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
        "double_lane_change", law="hinf_delay", gains="theorem", actuator="suspension"
    )
    settings = replace(nominal, bus="gateway_50ms")
    (row,) = figures(controller, [settings])
    cycle = experiment.simulate(settings, controller).limit_cycle
    assert cycle is not None
    assert (row["cycle_hz"], row["cycle_nm"]) == (cycle.frequency, cycle.amplitude)
