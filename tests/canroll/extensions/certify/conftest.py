"""Calibrations and their certificates, made once."""

from dataclasses import replace
from functools import cache

import pytest

from canroll import vehicles
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.calibration.options import QuantiseOptions
from canroll.gain_gen.design import design
from canroll.gain_gen.margin_report import task_of
from canroll.gain_gen.models.task import Delay, Task

DELAY = Delay(0.0144, 0.0056, 0.0231)
"""Of van_real on a bus of 500 kbit/s."""


@pytest.fixture(scope="session")
def calibrated(tmp_path_factory):
    """Return the loaded calibration of a law on the van."""

    @cache
    def of(law: str, delay: Delay = DELAY) -> LoadedCalibration:
        task = Task(vehicles.load("van_real"), delay, actuator="bars")
        record, tables = calibrate(design(law, task), QuantiseOptions())
        path = tmp_path_factory.mktemp("certificate") / "calibration.toml"
        calibration_file.save(path, record, tables)
        return calibration_file.load(path)

    return of


@pytest.fixture(scope="session")
def certified(calibrated):
    """Return the certificate of an output feedback on the first two cars of the family."""
    pytest.importorskip("flint")
    from canroll.extensions.certify import certificate, subject

    calibration = calibrated("hinf_delay")
    task = task_of(calibration)
    family = family_of(task)
    with pytest.MonkeyPatch.context() as patch:
        two = replace(family, members=family.members[:2])
        patch.setattr(subject, "family_of", lambda _: two)
        return certificate.certify(task, calibration)


@pytest.fixture(scope="session")
def integers(calibrated):
    """The integers of the calibration that is certified."""
    pytest.importorskip("flint")
    from support.certificates import integers_of

    return integers_of(calibrated("hinf_delay"))
