"""pyxcp, a master of others, with our A2L over simbus: measures, calibrates, changes pages."""

import importlib.util
import struct
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from canroll.codegen.run import memory_image
from canroll.extensions.services.ecu_on_bus import ecu_on_bus
from canroll.extensions.services.running import PAGE_ADDRESS

pytestmark = pytest.mark.slow

for name in ("asammdf", "pya2l.a2lparser", "pyxcp"):
    pytest.importorskip(name, reason=f"needs {name}")
XcpResponseError = pytest.importorskip("pyxcp.types", reason="needs pyxcp").XcpResponseError

ROOT = Path(__file__).parents[4]


@pytest.fixture(autouse=True)
def no_arguments(monkeypatch):
    """pyxcp would read those of pytest."""
    monkeypatch.setattr(sys, "argv", ["pyxcp"])


@pytest.fixture(scope="module")
def session():
    """The example as a module."""
    path = ROOT / "examples" / "xcp" / "session.py"
    spec = importlib.util.spec_from_file_location("xcp_session_example", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def where(session, tmp_path_factory):
    return session.located(tmp_path_factory.mktemp("a2l"))


def test_pyxcp_reads_writes_and_changes_pages(session, where):
    at = where["calibration.heartbeat_ticks"]
    record = session.RECORD
    with ecu_on_bus("xcp pages", record, ["xcp"]) as bus, session.master_on(bus) as master:
        assert master.slaveProperties.supportsCalpag and master.slaveProperties.supportsDaq
        assert not master.slaveProperties.supportsStim
        status = master.getStatus().resourceProtectionStatus
        assert not (status.calpag or status.daq)
        # the whole calibration, block by block
        master.setMta(PAGE_ADDRESS)
        image = memory_image.image(record)
        assert bytes(master.pull(len(image))) == image
        # a value on the working page, then the loop on it
        master.setCalPage(0x02, 0, 1)
        master.setMta(at)
        master.download(struct.pack("<i", 3))
        assert master.getCalPage(0x01, 0) == 0
        master.setCalPage(0x03, 0, 1)
        assert master.getCalPage(0x01, 0) == 1
        assert master.shortUpload(4, at) == struct.pack("<i", 3)
        master.setMta(at)
        with pytest.raises(XcpResponseError, match="WRITE_PROTECTED"):
            master.download(struct.pack("<i", 4))
        master.setCalPage(0x01, 0, 0)
        master.setMta(at)
        master.download(struct.pack("<i", 2_000_000))
        with pytest.raises(XcpResponseError, match="PAGE_NOT_VALID"):
            master.setCalPage(0x03, 0, 1)
        assert master.getCalPage(0x01, 0) == 0


def test_pyxcp_measures_by_lists(session, where):
    signals = session.SIGNALS | {"ecu.since_status": "I32", "calibration.tick_us": "I32"}
    policy = session.Samples([session.list_of(where, signals)])
    with ecu_on_bus("xcp lists", session.RECORD, ["xcp"]) as bus, session.master_on(bus, policy):
        policy.setup()
        policy.start()
        assert policy.enough.wait(session.SECONDS)
        policy.stop()
    tick_us = session.RECORD.tick_us
    assert set(policy.rows[0]) == {"stamp", *signals}
    ticks = [row["ecu.time"] for row in policy.rows]
    # a sample is of one tick: its time stamp, which pyxcp begins with 0, goes with the loop's time
    offsets = {row["stamp"] // 1000 - tick_us * row["ecu.time"] for row in policy.rows}
    assert len(offsets) == 1
    assert all(later > earlier for earlier, later in pairwise(ticks))
    assert {row["calibration.tick_us"] for row in policy.rows} == {tick_us}
