"""All backends give the same bytes: on the bus and in memory, tick by tick."""

import pytest
from support.replays import images, replayed

from canroll.codegen.run import backends, ecu_traffic, memory_image, native
from canroll.errors import CanrollError, UnknownNameError
from canroll.firmware.calibration import Calibration
from canroll.firmware.com.signals import RX_IDS, TX_IDS
from canroll.firmware.state import ACTIVE, DEGRADED, SAFE, Ecu

needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")


def python_states(calibration, traffic):
    """Frames sent and state images of the reference."""
    ecu = backends.open_backend("python", calibration)
    frames, states, k = [], [], 0
    for t in range(traffic.ticks):
        while k < len(traffic.frames) and traffic.frames["tick"][k] <= t:
            event = traffic.frames[k]
            ident = RX_IDS[event["message"]]
            ecu.receive(ident, event["payload"].tobytes(), int(event["length"]))
            k += 1
        frames += [(t, *frame) for frame in ecu.tick(int(traffic.elapsed[t]))]
        states.append(ecu.image())
    return frames, states


def compare(seed, ticks, hostile=0.15):
    calibration = ecu_traffic.random_calibration(seed)
    traffic = ecu_traffic.random_traffic(seed, ticks, hostile=hostile)
    frames, states = python_states(calibration, traffic)
    got = replayed(native.library(), calibration, traffic)
    for t, expected in enumerate(states):
        found = got.states[0, t].tobytes()
        assert found == expected, (seed, t, memory_image.differences(Ecu, expected, found))
    sent = [(int(f["tick"]), TX_IDS[f["message"]], f["payload"].tobytes()) for f in got.frames]
    assert sent == frames
    return {state["mode"] for state in got.states[0]}, calibration


@needs_cc
def test_native_is_python_on_hostile_traffic():
    modes, laws, observers, actuators = set(), set(), set(), set()
    # few calibrations have valves, as few may: the last has
    for seed in (*range(16), 55):
        found, calibration = compare(seed, 25, hostile=0.02 if seed % 2 else 0.15)
        modes |= found
        laws.add(calibration.law)
        observers.add(calibration.observer)
        actuators.add(calibration.actuator)
    assert {ACTIVE, DEGRADED, SAFE} <= modes
    assert laws == observers == {0, 1, 2}
    assert actuators == {0, 1, 2, 3}


@needs_cc
@pytest.mark.long
def test_native_is_python_for_long():
    for seed in range(100, 300):
        compare(seed, 500)


@needs_cc
def test_a_batch_is_its_single_ecus():
    library = native.library()
    records = [ecu_traffic.random_calibration(seed) for seed in range(5)]
    traffic = [ecu_traffic.random_traffic(seed, 60) for seed in range(5)]
    for each in traffic[1:]:
        each.elapsed[:] = traffic[0].elapsed
    cals = images(*records)
    together = library.start(cals)
    batch = library.replay(together, cals, traffic)
    begin = 0
    for i in range(5):
        alone = library.start(cals[i : i + 1])
        single = library.replay(alone, cals[i : i + 1], traffic[i : i + 1])
        assert alone.tobytes() == together[i : i + 1].tobytes()
        assert single.frames.tobytes() == batch.frames[begin : batch.ends[i]].tobytes()
        begin = batch.ends[i]


@needs_cc
def test_native_ecu_is_the_python_ecu_behind_the_interface():
    calibration = ecu_traffic.random_calibration(3)
    traffic = ecu_traffic.random_traffic(3, 30)
    frames, states = python_states(calibration, traffic)
    ecu = backends.open_backend("native", calibration)
    assert isinstance(ecu, backends.Backend)
    sent = []
    for t in range(traffic.ticks):
        for event in traffic.frames[traffic.frames["tick"] == t]:
            ecu.receive(RX_IDS[event["message"]], event["payload"], int(event["length"]))
        ecu.receive(0x7FF, b"12345678", 8)
        sent += [(t, *frame) for frame in ecu.tick(int(traffic.elapsed[t]))]
        assert ecu.image() == states[t]
    assert sent == frames
    assert memory_image.image(ecu.state) == states[-1]
    assert all(ecu.pointers[name] for name in ("init", "receive", "tick", "ecu", "calibration"))


@needs_cc
def test_compiled_callers_take_the_pointers():
    import ctypes

    calibration = ecu_traffic.random_calibration(4)
    ecu = backends.NativeEcu(calibration)
    where = ecu.pointers
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int32)
    tick = prototype(where["tick"])
    for _ in range(7):
        tick(where["ecu"], where["calibration"], 1)
    reference = backends.PythonEcu(calibration)
    for _ in range(7):
        reference.tick()
    mine, other = ecu.state, reference.state
    mine.tx_pending = other.tx_pending
    assert memory_image.image(mine) == memory_image.image(other)


@pytest.mark.parametrize("name", ["python", pytest.param("native", marks=needs_cc)])
def test_a_refused_calibration_does_not_run(name):
    with pytest.raises(CanrollError, match="refuses the calibration: rule"):
        backends.open_backend(name, Calibration())


def test_an_unknown_backend_is_named():
    with pytest.raises(UnknownNameError, match="did you mean 'native'"):
        backends.open_backend("nativ", ecu_traffic.random_calibration(0))


def test_images_round_trip():
    record = ecu_traffic.random_calibration(9)
    again = Calibration()
    memory_image.fill(again, memory_image.image(record))
    assert vars(again) == vars(record)


@needs_cc
def test_a_compiler_that_fails_is_reported(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(CanrollError, match="cannot build the firmware"):
        native.build({"canroll.h": "#error no\n"})
