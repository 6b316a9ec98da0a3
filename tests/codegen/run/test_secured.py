"""An ECU behind its authentication: all backends alike, starts counted, senders remembered."""

import numpy as np
import pytest
from cryptography.hazmat.primitives.ciphers import algorithms
from cryptography.hazmat.primitives.cmac import CMAC

from canroll import dbc
from canroll.codegen.run import cortex, ecu_traffic, unicorn
from canroll.codegen.run.backends import open_backend
from canroll.codegen.run.bus_firmware import built_in, of_bus
from canroll.codegen.run.native import compiler
from canroll.codegen.run.secured import SecocModule, SecuredEcu, listening_ticks
from canroll.codegen.run.unicorn import CortexEcu
from canroll.firmware.security.secoc_state import COUNTER_MAX, SECURED
from canroll.firmware.state import RX_IMU, TX_ANTI_ROLL_BAR

KEY = bytes(range(50, 66))
FIRMWARE = of_bus(dbc.SECURED_PATH, dbc.SECURED_MAP)
CALIBRATION = ecu_traffic.random_calibration(3)
IMU = FIRMWARE.bus.received[RX_IMU].ident
LISTENING = listening_ticks(CALIBRATION.tick_us)
BACKENDS = [
    "python",
    pytest.param("native", marks=pytest.mark.skipif(compiler() is None, reason="needs cc")),
    pytest.param(
        "cortex-m4",
        marks=pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]"),
    ),
]


def opened(backend):
    return open_backend(backend, CALIBRATION, FIRMWARE, key=KEY)


def mac(identity, payload, starts, count):
    judge = CMAC(algorithms.AES(KEY))
    freshness = starts.to_bytes(3, "big") + count.to_bytes(3, "big")
    judge.update(identity.to_bytes(2, "big") + payload + freshness)
    return freshness + judge.finalize()[:6]


def imu(count, starts=1):
    payload = bytearray(8)
    FIRMWARE.bus.received[RX_IMU].protection.apply(payload, count % 15)
    return bytes(payload) + mac(dbc.data_id(dbc.message("Imu")), bytes(payload), starts, count)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_sent_and_taken(backend):
    ecu = opened(backend)
    assert isinstance(ecu, SecuredEcu)
    ecu.receive(IMU, imu(0), SECURED)
    assert (ecu.accepted, ecu.refused) == (0, 0)
    sent = []
    for _ in range(60):
        sent += ecu.tick()
    identities = {m.frame_id: dbc.data_id(m) for m in dbc.load().messages}
    counts = {}
    for ident, data in sent:
        count = counts[ident] = counts.get(ident, -1) + 1
        assert data[8:] == mac(identities[ident], data[:8], 1, count)
    assert len(counts) >= 2
    for frame, length, taken, refused in (
        (imu(1), SECURED, 1, 0),
        (imu(1), SECURED, 1, 1),
        (imu(2)[:8], 8, 1, 2),
        (imu(2) + bytes(44), 64, 1, 3),
        (imu(2)[:19] + b"\0", SECURED, 1, 4),
        (imu(2), SECURED, 2, 4),
    ):
        ecu.receive(IMU, np.frombuffer(frame, np.uint8), length)
        assert (ecu.accepted, ecu.refused) == (taken, refused)
    ecu.receive(0x7FF, imu(3), SECURED)
    assert (ecu.accepted, ecu.refused) == (2, 4)


@pytest.mark.parametrize("backend", BACKENDS)
def test_lasting_memory(backend):
    """A restart is a new start, which goes on with the senders and refuses what is old."""
    ecu = opened(backend)
    ecu.tick(LISTENING)
    ecu.receive(IMU, imu(9, starts=100), SECURED)
    ecu.receive(IMU, imu(9, starts=100), SECURED)
    assert (ecu.accepted, ecu.refused) == (1, 1)
    ecu.restart()
    ecu.tick(LISTENING)
    ecu.receive(IMU, imu(5, starts=99), SECURED)
    ecu.receive(IMU, imu(0, starts=70_000), SECURED)
    assert (ecu.accepted, ecu.refused) == (2, 2)
    payload = bytes(8)
    ident, _ = FIRMWARE.sent[TX_ANTI_ROLL_BAR]
    expected = mac(dbc.data_id(dbc.message("AntiRollBarCommand")), payload, 2, 0)
    assert ecu.protected((ident, payload + bytes(12))) == (ident, payload + expected)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_start_that_began_behind_the_last_number_lasts(backend):
    ecu = opened(backend)
    ident, length = FIRMWARE.sent[TX_ANTI_ROLL_BAR]
    ecu._secoc.record["tx_freshness"] = [COUNTER_MAX] * len(FIRMWARE.sent)
    _, frame = ecu.protected((ident, bytes(length)))
    assert (ecu.lasting.starts, frame[8:14]) == (2, bytes([0, 0, 2, 0, 0, 0]))
    ecu.restart()
    assert ecu.lasting.starts == 3


@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
def test_a_replay_counts_what_authentication_costs():
    room = FIRMWARE.room
    rows = [(t, RX_IMU, SECURED, list(imu(t).ljust(room, b"\0"))) for t in range(30)]
    kind = ecu_traffic.random_traffic(1, 1, bus=FIRMWARE.bus).frames.dtype
    traffic = ecu_traffic.EcuTraffic(np.array(rows, kind), np.ones(30, np.int32))
    ran = unicorn.replay_secured(CALIBRATION, traffic, "cortex-m4", FIRMWARE, key=KEY)
    sent = np.bincount(ran.frames["tick"], minlength=30)
    assert ran.authentication.min() > 900
    assert (ran.authentication <= 1200 * (sent + 1) + 60).all()
    assert (ran.instructions > ran.authentication).all()


def test_a_plain_bus_has_no_authentication():
    assert not isinstance(open_backend("python", CALIBRATION, built_in()), SecuredEcu)


@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
@pytest.mark.parametrize(
    ("frame", "length", "most"),
    [(imu(5)[:14] + bytes(6), SECURED, 1100), (imu(4), SECURED, 60), (imu(5), 8, 30)],
    ids=["forged MAC", "old", "another length"],
)
def test_what_a_refused_frame_costs(frame, length, most):
    """Of a flood only frames with a plausible freshness value cost a MAC."""
    ecu = CortexEcu(CALIBRATION, cpu="cortex-m4", count=True, firmware=FIRMWARE)
    secoc = SecocModule(ecu.machine, ecu.firmware)
    secoc.start(KEY, 1, 0)
    assert secoc.verify(RX_IMU, imu(4), SECURED)
    assert not secoc.verify(RX_IMU, frame, length)
    assert most / 2 < ecu.machine.instructions < most
