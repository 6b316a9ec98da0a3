"""Calls out of order, times that are no numbers and damaged states are refused with a message."""

import math
import random

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave

from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import built_in
from canroll.extensions.exchange.fmu import ecu

TICK = 0.01


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    path = folder / "ecu.fmu"
    calibration = ecu_traffic.random_calibration(3)
    ecu.write(path, built_in(), calibration, title="ECU of a test", ports=ecu.PORTS[0])
    fmpy.extract(str(path), str(folder / "its"))
    return fmpy.read_model_description(str(path)), folder / "its"


@pytest.fixture
def make(archive):
    description, folder = archive

    def instance(*, events=True):
        slave = FMU3Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="ecu",
        )
        slave.instantiate(eventModeUsed=events)
        return slave

    return instance


PHASES = {
    "instantiated": [],
    "initialization": ["enterInitializationMode"],
    "event": ["enterInitializationMode", "exitInitializationMode"],
    "step": ["enterInitializationMode", "exitInitializationMode", "enterStepMode"],
    "terminated": ["enterInitializationMode", "exitInitializationMode", "terminate"],
}
CALLS = {
    "enterInitializationMode": {"instantiated"},
    "exitInitializationMode": {"initialization"},
    "enterEventMode": {"step"},
    "enterStepMode": {"event"},
    "updateDiscreteStates": {"event"},
    "step": {"step"},
    "terminate": {"event", "step"},
    "reset": set(PHASES),
}
"""In which phases a function may be called."""


def call(slave, name):
    if name == "step":
        slave.doStep(0.0, TICK)
    else:
        getattr(slave, name)()


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("name", CALLS)
def test_every_function_is_refused_where_it_must_not_be_called(make, capfd, phase, name):
    slave = make()
    for before in PHASES[phase]:
        call(slave, before)
    if phase in CALLS[name]:
        call(slave, name)
        return
    with pytest.raises(FMICallException):
        call(slave, name)
    assert "must not be called" in capfd.readouterr().out
    # the refused call has changed nothing
    for other, phases in CALLS.items():
        if phase in phases:
            call(slave, other)
            break


def test_event_mode_that_was_not_asked_for_is_refused(make, capfd):
    slave = make(events=False)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(0.0, TICK)
    with pytest.raises(FMICallException):
        slave.enterEventMode()
    assert "was not asked for" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("start", "size"),
    [(0.0, math.inf), (0.0, math.nan), (math.nan, TICK), (-math.inf, TICK), (0.0, 1e300)],
)
def test_a_step_of_no_number_is_refused(make, capfd, start, size):
    slave = make(events=False)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    with pytest.raises(FMICallException):
        slave.doStep(start, size)
    assert f"a step from {start:g} s of {size:g} s: both must be numbers" in capfd.readouterr().out
    slave.doStep(0.0, TICK)


@pytest.mark.parametrize("start", [math.nan, math.inf, 1e300])
def test_a_start_at_no_number_is_refused(make, capfd, start):
    slave = make()
    with pytest.raises(FMICallException):
        slave.enterInitializationMode(startTime=start)
    assert "a start at" in capfd.readouterr().out
    slave.enterInitializationMode()


def test_a_state_with_any_flipped_bit_is_refused(make, capfd):
    slave = make(events=False)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(0.0, TICK)
    kept = slave.serializeFMUState(slave.getFMUState())
    rng = random.Random(1)
    for k in range(0, len(kept), 7):
        damaged = bytearray(kept)
        damaged[k] ^= 1 << rng.randrange(8)
        with pytest.raises(FMICallException):
            slave.deserializeFMUState(bytes(damaged))
    said = capfd.readouterr().out
    assert "the serialised state is damaged" in said and "not one of this FMU" in said
    slave.setFMUState(slave.deserializeFMUState(kept))
    slave.doStep(TICK, TICK)
