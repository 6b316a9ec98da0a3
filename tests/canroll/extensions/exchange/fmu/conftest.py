"""An exported ECU of each kind."""

import numpy as np
import pytest

from canroll.codegen.run import ecu_traffic, memory_image
from canroll.codegen.run.bus_firmware import built_in
from canroll.extensions.exchange.fmu import ecu
from canroll.firmware.calibration import Calibration


@pytest.fixture(scope="session")
def calibration():
    return ecu_traffic.random_calibration(3)


@pytest.fixture(scope="session", params=ecu.PORTS)
def either(request, tmp_path_factory, calibration):
    path = tmp_path_factory.mktemp("fmu") / "ecu.fmu"
    ecu.write(path, built_in(), calibration, title="ECU of a test", ports=request.param)
    return path


@pytest.fixture(scope="session")
def can_ecu(tmp_path_factory, calibration):
    path = tmp_path_factory.mktemp("fmu") / "ecu.fmu"
    ecu.write(path, built_in(), calibration, title="ECU of a test", run_time_ns=200_000)
    return path


@pytest.fixture(scope="session")
def record(calibration):
    """The calibration in memory, as an array of one."""
    kind = memory_image.dtype(Calibration)
    return np.frombuffer(memory_image.image(calibration), kind, 1).copy()
