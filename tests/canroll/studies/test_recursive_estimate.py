"""What the ECU identified beside a fit: its interval, and a drive with a car that differs."""

import json

import numpy as np
import pytest
import tomli_w

from canroll import vehicles
from canroll.cli.main import main
from canroll.firmware.identification import RATIO_ONE
from canroll.gain_gen.calibration import calibration_file
from canroll.runs import experiment, logs
from canroll.studies.recursive_estimate import estimates
from canroll.vehicles.draws.fitted_cars import draws

STIFFER = 1.2


def fitted(vehicle):
    plant = vehicle.plant
    fit = {
        "log": "a.csv",
        "names": [
            "plant.roll_stiffness",
            "plant.cg_height_above_roll_axis",
            "plant.roll_damping",
            "plant.sprung_mass",
        ],
        "deviations": [
            0.02 * plant.roll_stiffness,
            0.03 * plant.cg_height_above_roll_axis,
            0.05 * plant.roll_damping,
            0.05 * plant.sprung_mass,
        ],
        "correlation": [[1.0], [0.9, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]],
    }
    return vehicles.from_table(vehicle.document | {"fit": fit}, name=vehicle.name)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A log of a van that is stiffer in roll than that of the calibration."""
    folder = tmp_path_factory.mktemp("drive")
    stiffer = vehicles.load("van_real").plant.roll_stiffness * STIFFER
    settings, controller = experiment.plan(
        "slalom",
        vehicle="van_real",
        plant_vehicle=vehicles.load("van_real").replace({"plant.roll_stiffness": stiffer}),
        plant="roll1",
        law="plain_feedforward",
        identification=True,
    )
    trace = experiment.simulate(settings, controller).controlled
    logs.write_log(folder / "drive.blf", trace.frames)
    calibration_file.save(folder / "c.toml", controller.record, controller.tables)
    return folder, controller.record, settings.vehicle


def test_a_stiffer_car_is_identified_and_judged_by_the_fit(drive, capsys, tmp_path):
    folder, _, car = drive
    truth = fitted(car)
    (tmp_path / "fitted.toml").write_text(tomli_w.dumps(truth.document))
    words = ["ecu", "--replay", str(folder / "drive.blf"), "--calibration", str(folder / "c.toml")]
    words += ["--fitted", str(tmp_path / "fitted.toml")]
    assert main([*words, "--json", "--out", str(tmp_path / "o")]) == 0
    stiffness, damping = json.loads(capsys.readouterr().out)["identified"]
    assert stiffness["start"] < stiffness["fitted"]
    assert stiffness["fitted"] == pytest.approx(car.plant.effective_stiffness)
    assert stiffness["recursive"] == pytest.approx(stiffness["fitted"], rel=0.1)
    assert damping["fitted"] == car.plant.roll_damping
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    printed = capsys.readouterr().out
    assert "Identified by the ECU" in printed
    assert "N·m·s/rad" in printed


def test_the_interval_is_that_of_drawn_cars(drive):
    _, record, car = drive
    truth = fitted(car)
    one, other = estimates((1.0, 1.0), record, car, truth)
    cars = draws(truth, 2000)
    stiffness = np.std([each.plant.effective_stiffness for each in cars])
    damping = np.std([each.plant.roll_damping for each in cars])
    assert one.half_width == pytest.approx(1.96 * stiffness, rel=0.08)
    assert other.half_width == pytest.approx(1.96 * damping, rel=0.08)


def test_a_number_at_its_bound_is_marked(drive):
    _, record, car = drive
    edge = record.rls_hi[0] / RATIO_ONE
    one, other = estimates((edge, 1.0), record, car, None)
    assert one.bounded
    assert not other.bounded
    assert one.fitted is None


def test_a_vehicle_without_a_fit_is_none_to_compare_with(drive, capsys, tmp_path):
    folder, _, _ = drive
    words = ["ecu", "--replay", str(folder / "drive.blf"), "--calibration", str(folder / "c.toml")]
    assert main([*words, "--fitted", "van_real", "--out", str(tmp_path / "o")]) == 2
    assert "van_real has no [fit]" in capsys.readouterr().err


def test_an_ecu_that_does_not_identify_has_nothing_to_compare(drive, capsys, tmp_path):
    folder, _, _ = drive
    _, controller = experiment.plan("slalom", vehicle="van_real", law="plain_feedforward")
    calibration_file.save(tmp_path / "c.toml", controller.record, controller.tables)
    words = ["ecu", "--replay", str(folder / "drive.blf"), "--calibration"]
    words += [str(tmp_path / "c.toml"), "--fitted", "van_real", "--out", str(tmp_path / "o")]
    assert main(words) == 2
    assert "does not identify: design it with --identification" in capsys.readouterr().err
