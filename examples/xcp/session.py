"""pyxcp measures and calibrates the ECU on a bus that behaves like CAN, and records an MF4 file.

    python examples/xcp/session.py FOLDER [CHANNEL]

Needs ``canroll[xcp,asammdf]``. The ECU and the tool are two nodes of simbus, or of SocketCAN where
a ``CHANNEL`` such as vcan0 is given; addresses are those of our A2L, as pya2ldb reads it. Writes
FOLDER/canroll.a2l and FOLDER/measured.mf4.
"""

import logging
import struct
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import asammdf
import can
import numpy as np
from pya2l import model
from pya2l.a2lparser import A2LParser
from pyxcp import config
from pyxcp.daq_stim import DaqList, DaqOnlinePolicy
from pyxcp.master import Master
from pyxcp.types import XcpResponseError

from canroll.codegen.export import a2l
from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import built_in
from canroll.extensions.services.ecu_on_bus import ecu_on_bus
from canroll.extensions.services.running import PAGE_ADDRESS, STATE_ADDRESS, xcp_idents
from canroll.extensions.services.xcp_description import described

IDS = xcp_idents(built_in())
RECORD = ecu_traffic.random_calibration(3)
SECONDS = 60.0
"""The tool waits so long for an answer: on a busy machine the ECU's thread may be late."""
SIGNALS = {"ecu.time": "I32", "ecu.roll_rate": "I32", "ecu.mode": "U8", "ecu.authority": "I32"}
SAMPLES = 50


class Samples(DaqOnlinePolicy):  # type: ignore[misc]
    """Keeps the samples of all lists, by name."""

    def __init__(self, lists: list[DaqList]) -> None:
        super().__init__(lists)
        self.rows: list[dict[str, int]] = []
        self.enough = threading.Event()

    def on_daq_list(self, daq_list: int, stamp0: int, stamp1: int, payload: Sequence[int]) -> None:
        """Called by pyxcp for each sample; ``stamp1`` is the ECU's time in ns."""
        names = [header[0] for header in self.daq_lists[daq_list].headers]
        self.rows.append({"stamp": stamp1} | dict(zip(names, payload, strict=True)))
        if len(self.rows) >= SAMPLES:
            self.enough.set()


@contextmanager
def master_on(bus: can.BusABC, policy: Samples | None = None) -> Iterator[Any]:
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


def located(folder: Path) -> dict[str, int]:
    """Address of each name, as pya2ldb reads it in our A2L, which is written to ``folder``."""
    software = a2l.Software("canroll example", RECORD, IDS, slave=described(RECORD.tick_us))
    path = folder / "canroll.a2l"
    base = {"calibration": PAGE_ADDRESS, "ecu": STATE_ADDRESS}
    path.write_text(a2l.a2l(software, base), encoding="ascii")
    reader = A2LParser()
    opened = reader.parse(str(path), in_memory=True, progress_bar=False, loglevel="ERROR")
    module = opened.session.query(model.Module).one()
    found = {each.name: int(each.ecu_address.address) for each in module.measurement}
    found |= {each.name: int(each.address) for each in module.characteristic}
    opened.close()
    return found


def list_of(where: dict[str, int], signals: dict[str, str]) -> DaqList:
    """A list of pyxcp, sampled in every tick."""
    rows = [(name, where[name], 0, kind) for name, kind in signals.items()]
    return DaqList(name="tick", event_num=0, stim=False, enable_timestamps=True, measurements=rows)


def calibrate(tool: Master, where: dict[str, int]) -> None:
    """Change a value on the working page, and let the loop run on it, or not."""
    at = where["calibration.heartbeat_ticks"]
    before = struct.unpack("<i", tool.shortUpload(4, at))[0]
    tool.setCalPage(0x02, 0, 1)
    for value in (3, 2_000_000):
        tool.setMta(at)
        tool.download(struct.pack("<i", value))
        try:
            tool.setCalPage(0x03, 0, 1)
        except XcpResponseError as error:
            print(f"heartbeat_ticks {before} -> {value}: {error}")
        else:
            page = tool.getCalPage(0x01, 0)
            print(f"heartbeat_ticks {before} -> {value}: the loop is on page {page}")
        tool.setCalPage(0x01, 0, 0)


def record(rows: Sequence[dict[str, int]], path: Path) -> None:
    """Write samples as MF4."""
    times = np.array([row["stamp"] for row in rows]) * 1e-9
    names = [name for name in rows[0] if name != "stamp"]
    signals = [
        asammdf.Signal(np.array([row[name] for row in rows]), times, name=name) for name in names
    ]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals, comment="XCP, list 'tick'")
        file.save(path, overwrite=True)


def main(folder: Path, channel: str | None = None) -> None:
    """Measure, calibrate, record; on simbus, or on a channel of SocketCAN."""
    interface = "simbus" if channel is None else "socketcan"
    folder.mkdir(parents=True, exist_ok=True)
    where = located(folder)
    policy = Samples([list_of(where, SIGNALS)])
    with (
        ecu_on_bus(channel or "xcp example", RECORD, ["xcp"], interface=interface) as bus,
        master_on(bus, policy) as tool,
    ):
        properties = tool.slaveProperties
        print(f"connected: MAX_CTO {properties.maxCto}, pages {properties.supportsCalpag}")
        policy.setup()
        policy.start()
        policy.enough.wait(SECONDS)
        policy.stop()
        calibrate(tool, where)
    rows = policy.rows[:SAMPLES]
    record(rows, folder / "measured.mf4")
    step = rows[1]["stamp"] - rows[0]["stamp"]
    print(f"{len(rows)} samples of {len(SIGNALS)} signals every {step / 1e6:g} ms: measured.mf4")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:3])
