"""What outlives a loss of power, in a bundle: its note, and its test by the reference."""

from canroll.codegen.export.contents import Code, Export
from canroll.codegen.export.sessions.session import Session
from canroll.codegen.run import memory_image, native
from canroll.codegen.run.ecu import EcuBackend
from canroll.extensions.services.modules import nvm_state
from canroll.extensions.services.running import Server
from canroll.firmware.calibration import Calibration

NOTE = """
## Non-volatile memory

Fault memory, learnt offsets{snapshots} outlive a loss of power in one record,
`static canroll_nvm nvm;` ({size} bytes, `canroll_nvm_size(&nvm)`).
Before power goes, or now and then, in the context of the tick:
`canroll_nvm_save(&nvm, &ecu, &calibration);`{save} Then write the record
as it is to your memory; nothing of it changes meanwhile. After `canroll_init`{init}
read it back and call `canroll_nvm_restore(&nvm, &ecu, &calibration);`{restore}
0 means restored; 1: no record, or one of another version, 2: damaged (CRC-32), 3: saved with a
calibration of another id. Then the ECU is as after `canroll_init`. Two places, written in turn,
keep the last good record where power goes during a write.
"""
SAVE = " `canroll_nvm_uds_save(&nvm, &uds);`"
RESTORE = "\nthen `canroll_nvm_uds_restore(&nvm, &uds, &ecu, &calibration);`."


def note(_: Export, code: Code) -> str:
    """Return the section of the README."""
    firmware = code.served
    uds = "nvm_uds" in firmware.services
    return NOTE.format(
        snapshots=" and the snapshots of fault codes" if uds else "",
        size=memory_image.dtype(firmware.module("nvm_state").Nvm).itemsize,
        save=SAVE if uds else "",
        init=" and `canroll_uds_init`" if uds else "",
        restore=RESTORE if uds else "",
    )


def source(export: Export, code: Code) -> str:
    """The session in C: a record saved after the traffic, damaged, and restored."""
    firmware, record = code.served, export.record
    session = Session(native.NativeMachine(firmware), firmware)
    session.begin("NVM")
    ecu = EcuBackend(session, record, firmware)
    served = "nvm_uds" in firmware.services
    server = Server(ecu) if served else None
    state, cal = session.records["ecu"], session.records["calibration"]
    for elapsed, frames in export.traffic.by_tick():
        session.tick(state, cal, elapsed, frames)
        if server is not None:
            server.tick(elapsed)
    nvm = session.record(firmware.module("nvm_state").Nvm())
    session.call("nvm.save", nvm, state, cal)
    if server is not None:
        session.call("nvm_uds.save", nvm, server.record)
    session.digest(nvm)
    session.call("nvm.size", nvm)
    started = [session.record(firmware.record())]
    session.call("init", started[0], cal)
    if served:
        started.append(session.record(firmware.module("uds_state").Uds()))
        session.call("uds.init", started[1], started[0])

    def restored() -> int:
        """Restore; return the reason of a refusal, after which all is as it was."""
        rule = session.call("nvm.restore", nvm, started[0], cal)
        if served and rule == 0:
            rule = session.call("nvm_uds.restore", nvm, started[1], started[0], cal)
        return rule

    before = [each.image() for each in started]
    saved = nvm.image()
    for at in range(len(saved)):
        nvm.flip(at, at & 7)
        assert restored() != 0
        nvm.flip(at, at & 7)
    nvm.fill(b"\xff" * len(saved))
    assert restored() == nvm_state.ANOTHER_VERSION
    nvm.fill(saved)
    places = memory_image.dtype(Calibration).fields
    assert places is not None
    cal.flip(int(places["id"][1]))
    assert restored() == nvm_state.ANOTHER_CALIBRATION
    cal.flip(int(places["id"][1]))
    assert [each.image() for each in started] == before
    for each in started:
        session.digest(each)
    assert restored() == 0
    for each in started:
        session.digest(each)
    return session.source(
        "What outlives a loss of power: saved, damaged, restored.",
        f"NVM, a record of {len(saved)} bytes",
    )
