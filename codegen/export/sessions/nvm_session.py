"""What outlives a loss of power, in a bundle: its note, and its test by the reference."""

from importlib.resources import files

import numpy as np

from codegen.run import memory_image, native
from codegen.run.backends import NativeEcu
from codegen.run.bus_firmware import BusFirmware
from codegen.run.ecu_traffic import Traffic
from codegen.run.served import ServedEcu
from firmware.calibration import Calibration

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
keep the last good record where power goes during a write. `test/test_nvm.c` does all this.
"""
SAVE = " `canroll_nvm_uds_save(&nvm, &uds);`"
RESTORE = "\nthen `canroll_nvm_uds_restore(&nvm, &uds, &ecu, &calibration);`."
FILES = "| `test/test_nvm.c` | what outlives a loss of power: saved, damaged, restored |\n"


def note(firmware: BusFirmware) -> str:
    """Return the section of the README."""
    uds = "nvm_uds" in firmware.services
    return NOTE.format(
        snapshots=" and the snapshots of fault codes" if uds else "",
        size=memory_image.dtype(firmware.module("services.nvm_state").Nvm).itemsize,
        save=SAVE if uds else "",
        init=" and `canroll_uds_init`" if uds else "",
        restore=RESTORE if uds else "",
    )


def sources(firmware: BusFirmware, record: Calibration, traffic: Traffic) -> dict[str, str]:
    """Return the test by its places in the bundle: its program, and the reference's CRC."""
    uds = "nvm_uds" in firmware.services
    lines = [
        "/* The record that the reference saves after the test vectors. */",
        f"#define NVM_CRC 0x{_crc(firmware, record, traffic):08X}u",
        *(["#define NVM_UDS 1"] if uds else []),
    ]
    template = files("codegen.export").joinpath("templates", "test_nvm.c")
    return {
        "test/test_nvm.c": template.read_text(encoding="utf-8"),
        "test/nvm_session.h": "\n".join([*lines, ""]),
    }


def _crc(firmware: BusFirmware, record: Calibration, traffic: Traffic) -> int:
    """The CRC of the record that CPython saves of the compiled ECU's state after the traffic."""
    ecu = NativeEcu(record, firmware)
    served = ServedEcu(ecu, record, firmware)
    library = native.library_of(firmware)
    state = library.ffi.from_buffer("uint8_t[]", ecu.ecu, require_writable=True)
    frames, place = traffic.frames, 0
    for tick, elapsed in enumerate(traffic.elapsed.tolist()):
        while place < len(frames) and frames[place]["tick"] == tick:
            its = frames[place]
            payload = its["payload"].tobytes()
            library.lib.canroll_put(state, int(its["message"]), payload, int(its["length"]))
            place += 1
        served.run(elapsed)
    nvm = firmware.module("services.nvm_state").Nvm()
    last = firmware.record()
    memory_image.fill(last, ecu.image())
    firmware.module("services.nvm").save(nvm, last, record)
    if "uds" in served.services:
        uds = firmware.module("services.uds_state").Uds()
        memory_image.fill(uds, np.asarray(served.services["uds"].record).tobytes())
        firmware.module("services.nvm_uds").save(nvm, uds)
    return int(nvm.crc) & 0xFFFFFFFF
