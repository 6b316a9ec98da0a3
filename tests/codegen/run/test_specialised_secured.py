"""A specialised loop behind its authentication: the bytes of the general one, in fewer steps."""

import numpy as np
import pytest

from canroll.codegen.run import cortex, ecu_traffic, native, unicorn
from canroll.codegen.run.backends import open_backend
from canroll.codegen.run.bus_firmware import of_bus
from canroll.codegen.run.specialised import specialised
from canroll.dbc import SECURED_MAP, SECURED_PATH
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.firmware.state import ACTIVE
from tools import recorded_traffic
from tools.recorded_traffic import Case

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
]
GENERAL = of_bus(SECURED_PATH, SECURED_MAP)


@pytest.fixture(scope="module")
def recording():
    return recorded_traffic.record(Case("double_lane_change", "lqr", bus="secured_fd"), 3.0)


@pytest.fixture(scope="module")
def special(recording):
    return specialised(GENERAL, recording.calibration)


def session(firmware, recording, traffic, backend="native"):
    """All frames sent, the state after each tick, and frames taken and refused."""
    ecu = open_backend(backend, recording.calibration, firmware)
    bounds = np.searchsorted(traffic.frames["tick"], np.arange(traffic.ticks + 1))
    sent, states, modes = [], [], set()
    for t in range(traffic.ticks):
        for event in traffic.frames[bounds[t] : bounds[t + 1]]:
            ident = firmware.bus.received[event["message"]].ident
            ecu.receive(ident, event["payload"].tobytes(), int(event["length"]))
        sent.append(ecu.tick(int(traffic.elapsed[t])))
        states.append(ecu.image())
        modes.add(int(ecu.state.mode))
    return sent, states, (ecu.accepted, ecu.refused), modes


def test_it_sends_and_keeps_the_same_bytes_over_a_manoeuvre(recording, special):
    general = session(GENERAL, recording, recording.traffic)
    assert session(special, recording, recording.traffic) == general
    sent, _, (accepted, refused), modes = general
    assert accepted > 600
    assert refused == 0
    assert sum(map(len, sent)) > 100
    assert all(len(payload) == 20 for frames in sent for _, payload in frames)
    assert ACTIVE in modes


def test_it_refuses_the_same_damaged_frames(recording, special):
    traffic = ecu_traffic.disturbed(recording.traffic, 1, quiet=40.0, bus=GENERAL.bus)
    general = session(GENERAL, recording, traffic)
    assert session(special, recording, traffic) == general
    accepted, refused = general[2]
    assert accepted > 300
    assert refused > 5


def test_the_authentication_stays_as_it_is(special):
    for name in ("secoc", "cmac", "aes", "aes_tables"):
        file = f"canroll_{name}.c"
        assert special.files[file] == GENERAL.files[file]
    assert "cal->" not in special.files["canroll_ecu.c"]


@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
def test_on_a_processor_its_ticks_are_shorter_and_the_authentication_costs_the_same(
    recording, special
):
    frames = recording.traffic.frames
    short = ecu_traffic.EcuTraffic(frames[frames["tick"] < 60], recording.traffic.elapsed[:60])
    general, own = (
        unicorn.replay_secured(
            recording.calibration, short, "cortex-m4", firmware, key=DEVELOPMENT_KEY
        )
        for firmware in (GENERAL, special)
    )
    assert own.states.tobytes() == general.states.tobytes()
    assert own.frames.tobytes() == general.frames.tobytes()
    assert own.authentication.tolist() == general.authentication.tolist()
    loops = [(ran.instructions - ran.authentication)[20:].mean() for ran in (general, own)]
    assert loops[1] < 0.7 * loops[0]
