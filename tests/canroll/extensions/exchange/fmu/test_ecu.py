"""The ECU's FMU sends what the native firmware sends, and is what FMI 3.0 says."""

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from support.fmus import importer, transmit

from canroll.codegen.run import ecu_traffic, native
from canroll.codegen.run.bus_firmware import built_in
from canroll.extensions.exchange.fmu import ecu
from canroll.firmware.state import ACTIVE
from canroll.firmware.subset import fields

pytestmark = pytest.mark.slow

TICK, RUN_TIME = 10_000_000, 200_000


def replayed(path, record, ticks, seed, fmu=None):
    """Frames of FMU and native firmware, and both states after the last tick."""
    traffic = ecu_traffic.random_traffic(seed, ticks)
    # a frame on a bus has as many bytes as it says
    fitting = (traffic.frames["length"] >= 0) & (traffic.frames["length"] <= 8)
    frames = traffic.frames[fitting]
    elapsed = np.ones(ticks, np.int32)
    library = native.library()
    ecus = library.start(record)
    native_run = library.replay(ecus, record, [ecu_traffic.EcuTraffic(frames, elapsed)])
    boxes = built_in().bus.received
    starts = np.searchsorted(frames["tick"], np.arange(ticks + 1))
    fmu = fmu or importer().Fmu(path)
    sent = []
    for k in range(ticks):
        fmu.advance((k + 1) * TICK)
        operations = b"".join(
            transmit(boxes[f["message"]].ident, bytes(f["payload"][: f["length"]]))
            for f in frames[starts[k] : starts[k + 1]]
        )
        fmu.read([])
        fmu.give({"CAN": operations} if operations else {})
        fmu.advance((k + 1) * TICK + RUN_TIME)
        sent += [(k, *f) for f in importer_frames(fmu.read(["CAN"])["CAN"])]
        fmu.give({})
    lengths = [box.sent_length for box in built_in().bus.transmitted]
    idents = [box.ident for box in built_in().bus.transmitted]
    wanted = [
        (int(f["tick"]), idents[f["message"]], bytes(f["payload"][: lengths[f["message"]]]))
        for f in native_run.frames
    ]
    return fmu, sent, wanted, ecus


importer_frames = importer().frames_of


def state_of(fmu):
    """The state record in the FMU, by field."""
    return {its.name: list(fmu.get(f"ecu.{its.name}")) for its in fields(built_in().record)}


def same_frames(path, record, ticks, seed):
    fmu, sent, wanted, ecus = replayed(path, record, ticks, seed)
    assert len(wanted) > ticks // 2
    assert sent == wanted
    last = {name: np.ravel(ecus[0][name]).tolist() for name in ecus.dtype.names}
    assert state_of(fmu) == last
    fmu.close()


def test_the_standard_is_met(either):
    assert validate_fmu(str(either)) == []


def test_fmpy_simulates_it(either):
    result = fmpy.simulate_fmu(str(either), stop_time=1.0, step_size=0.01)
    # on a bus it hears nothing here, so that it waits in INIT and commands nothing
    assert (result["commands_sent"][-1] > 10) == (result["mode"][-1] == ACTIVE)


def test_frames_are_those_of_the_native_firmware(can_ecu, record):
    same_frames(can_ecu, record, 3000, 5)


@pytest.mark.long
def test_frames_of_a_hundred_thousand_ticks(can_ecu, record):
    same_frames(can_ecu, record, 100_000, 6)


def test_a_state_taken_back_gives_the_same_frames(can_ecu, record):
    fmu = importer().Fmu(can_ecu)
    replayed(can_ecu, record, 50, 5, fmu)
    state = fmu.slave.getFMUState()
    kept = fmu.slave.serializeFMUState(state)
    now = fmu.now

    def go_on(fmu):
        sent = []
        for k in range(30):
            fmu.advance(now + k * TICK)
            sent.append(fmu.read(["CAN"])["CAN"])
            fmu.give({})
        return sent, state_of(fmu)

    first = go_on(fmu)
    fmu.slave.setFMUState(state)
    fmu.now = now
    assert go_on(fmu) == first
    other = importer().Fmu(can_ecu)
    restored = other.slave.deserializeFMUState(kept)
    other.slave.setFMUState(restored)
    other.now = now
    assert go_on(other) == first
    with pytest.raises(FMICallException):
        other.slave.deserializeFMUState(kept[:-1])


def test_parameters_are_those_of_the_calibration(can_ecu, calibration):
    fmu = importer().Fmu(can_ecu, {"calibration.status_ticks": 7})
    assert fmu.get("calibration.status_ticks") == [7]
    assert fmu.get("calibration.heartbeat_ticks") == [calibration.heartbeat_ticks]
    times = []
    for k in range(1, 30):
        fmu.advance(k * TICK + RUN_TIME)
        if 0x300 in [ident for ident, _ in importer_frames(fmu.read(["CAN"])["CAN"])]:
            times.append(k)
        fmu.give({})
    assert np.diff(times).tolist() == [7] * (len(times) - 1)
    with pytest.raises(FMICallException):
        fmu.set("calibration.status_ticks", 3)


def test_a_calibration_that_check_refuses_does_not_start(can_ecu, capfd):
    with pytest.raises(FMICallException):
        importer().Fmu(can_ecu, {"calibration.status_ticks": 0})
    assert "refuses the calibration: rule" in capfd.readouterr().out


def test_frames_that_nobody_takes_are_an_error(can_ecu):
    fmu = importer().Fmu(can_ecu)
    with pytest.raises(FMICallException):
        fmu.advance(20_000 * TICK)


def test_broken_operations_are_refused(can_ecu):
    for broken in (b"\x10", transmit(0xA0, bytes(8))[:-1], transmit(0xA0, bytes(9))):
        fmu = importer().Fmu(can_ecu)
        fmu.advance(TICK)
        fmu.read([])
        with pytest.raises(FMICallException):
            fmu.give({"CAN": broken})


def test_the_same_export_gives_the_same_bytes(can_ecu, calibration, tmp_path):
    ecu.write(tmp_path / "again.fmu", built_in(), calibration, title="ECU of a test")
    assert (tmp_path / "again.fmu").read_bytes() == can_ecu.read_bytes()
