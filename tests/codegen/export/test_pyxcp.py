"""pyxcp, a master of others, with our A2L over simbus: measures, calibrates, changes pages."""

import logging
import struct
import threading
from contextlib import contextmanager
from itertools import pairwise

import can
import pytest

from codegen.export import a2l
from codegen.run import ecu_traffic, memory_image, native
from codegen.run.backends import NativeEcu, PythonEcu
from codegen.run.bus_firmware import built_in, with_services
from codegen.run.xcp_slave import PAGE_ADDRESS, STATE_ADDRESS, XcpEcu, idents

a2lparser = pytest.importorskip("pya2l.a2lparser", reason="needs pya2ldb")
model = pytest.importorskip("pya2l.model", reason="needs pya2ldb")
config = pytest.importorskip("pyxcp.config", reason="needs pyxcp")
daq_stim = pytest.importorskip("pyxcp.daq_stim", reason="needs pyxcp")
Master = pytest.importorskip("pyxcp.master", reason="needs pyxcp").Master
XcpResponseError = pytest.importorskip("pyxcp.types", reason="needs pyxcp").XcpResponseError

SERVED = with_services(built_in(), ("xcp",))
RECORD = ecu_traffic.random_calibration(3)
IDS = idents(SERVED)
SECONDS = 60.0


class EcuOnBus(threading.Thread):
    """The ECU in a thread: as many ticks as it can, its frames on a bus that behaves like CAN."""

    def __init__(self, bus):
        super().__init__(daemon=True)
        self.bus, self.done = bus, threading.Event()
        kind = NativeEcu if native.compiler() else PythonEcu
        self.ecu = XcpEcu(kind(RECORD, SERVED), RECORD, SERVED)

    def run(self):
        while not self.done.is_set():
            message = self.bus.recv(0.002)
            if message is not None:
                self.ecu.receive(message.arbitration_id, message.data, len(message.data))
            for ident, payload in self.ecu.tick():
                if ident == IDS.slave:
                    self.bus.send(
                        can.Message(arbitration_id=ident, data=payload, is_extended_id=False)
                    )


@pytest.fixture
def bus():
    """A node for the tool on a bus with the ECU."""
    channel = f"xcp {id(object())}"
    ours = can.Bus(channel, interface="simbus", bitrate=500_000, queue="priority")
    theirs = can.Bus(channel, interface="simbus", bitrate=500_000)
    thread = EcuOnBus(ours)
    thread.start()
    yield theirs
    thread.done.set()
    thread.join()
    ours.shutdown()
    theirs.shutdown()


@contextmanager
def master_on(bus, policy=None):
    """pyxcp's master on a node, connected."""
    settings = {"can_id_master": IDS.master, "can_id_slave": IDS.slave}
    application = config.create_application_from_config(
        {"Transport": {"CAN": settings}, "General": {"disable_error_handling": True}},
        log_level=logging.ERROR,
    )
    application.transport.timeout = SECONDS
    config.set_application(application)
    try:
        with Master(
            "can", config=application, policy=policy, transport_layer_interface=bus
        ) as tool:
            tool.connect()
            yield tool
            tool.disconnect()
    finally:
        config.reset_application()


def located(folder):
    """Address of each name, as pya2ldb reads it in our A2L."""
    software = a2l.Software("canroll test", RECORD, IDS, slave=True)
    path = folder / "canroll.a2l"
    path.write_text(a2l.a2l(software, {"calibration": PAGE_ADDRESS, "ecu": STATE_ADDRESS}))
    reader = a2lparser.A2LParser()
    opened = reader.parse(str(path), in_memory=True, progress_bar=False, loglevel="ERROR")
    module = opened.session.query(model.Module).one()
    measured = {each.name: each.ecu_address.address for each in module.measurement}
    tuned = {each.name: each.address for each in module.characteristic}
    opened.close()
    return measured | tuned


def test_pyxcp_reads_writes_and_changes_pages(bus, tmp_path):
    with master_on(bus) as master:
        session(master, located(tmp_path))


def session(master, where):
    assert master.slaveProperties.supportsCalpag and master.slaveProperties.supportsDaq
    assert not master.slaveProperties.supportsStim
    assert where["calibration.heartbeat_ticks"] > PAGE_ADDRESS
    at = where["calibration.heartbeat_ticks"]
    assert master.shortUpload(4, at) == struct.pack("<i", RECORD.heartbeat_ticks)
    status = master.getStatus().resourceProtectionStatus
    assert not (status.calpag or status.daq)
    # the whole calibration, block by block
    master.setMta(PAGE_ADDRESS)
    image = memory_image.image(RECORD)
    assert bytes(master.pull(len(image))) == image
    # a value on the working page, then the loop on it
    master.setCalPage(0x02, 0, 1)
    master.setMta(at)
    master.download(struct.pack("<i", 3))
    assert master.getCalPage(0x01, 0) == 0
    master.setCalPage(0x03, 0, 1)
    assert master.getCalPage(0x01, 0) == 1
    with pytest.raises(XcpResponseError, match="WRITE_PROTECTED"):
        master.setMta(at)
        master.download(struct.pack("<i", 4))
    master.setCalPage(0x01, 0, 0)
    master.setMta(at)
    master.download(struct.pack("<i", 2_000_000))
    with pytest.raises(XcpResponseError, match="PAGE_NOT_VALID"):
        master.setCalPage(0x03, 0, 1)
    assert master.getCalPage(0x01, 0) == 0


class Samples(daq_stim.DaqOnlinePolicy):
    """Keeps the samples of all lists."""

    def __init__(self, lists):
        super().__init__(lists)
        self.rows, self.enough = [], threading.Event()

    def on_daq_list(self, daq_list, timestamp0, timestamp1, payload):
        names = [header[0] for header in self.daq_lists[daq_list].headers]
        self.rows.append({"stamp": timestamp1} | dict(zip(names, payload, strict=True)))
        if len(self.rows) >= 50:
            self.enough.set()


def test_pyxcp_measures_by_lists(bus, tmp_path):
    where = located(tmp_path)
    names = ["ecu.time", "ecu.roll_rate", "ecu.mode", "ecu.since_status", "calibration.tick_us"]
    kinds = ["I32", "I32", "U8", "I32", "I32"]
    rows = [(name, where[name], 0, kind) for name, kind in zip(names, kinds, strict=True)]
    policy = Samples(
        [
            daq_stim.DaqList(
                name="tick", event_num=0, stim=False, enable_timestamps=True, measurements=rows
            )
        ]
    )
    with master_on(bus, policy):
        policy.setup()
        policy.start()
        assert policy.enough.wait(SECONDS)
        policy.stop()
    ticks = [row["ecu.time"] for row in policy.rows]
    # a sample is of one tick: its time stamp, which pyxcp begins with 0, goes with the loop's time
    offsets = {row["stamp"] // 1000 - RECORD.tick_us * row["ecu.time"] for row in policy.rows}
    assert len(offsets) == 1
    assert all(later > earlier for earlier, later in pairwise(ticks))
    assert {row["calibration.tick_us"] for row in policy.rows} == {RECORD.tick_us}
