"""A firmware on recorded or random traffic: compiled, and the same in CPython."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.run import memory_image, native
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.firmware.calibration import Calibration


def images(*calibrations: Calibration) -> NDArray[np.void]:
    """Calibrations as the memory of a library has them, an ECU each."""
    data = bytearray(b"".join(map(memory_image.image, calibrations)))
    return np.frombuffer(data, memory_image.dtype(Calibration))


def replayed(
    library: native.Library, calibration: Calibration, traffic: EcuTraffic
) -> native.Replay:
    """All frames sent, and the state after each tick."""
    cals = images(calibration)
    return library.replay(library.start(cals), cals, [traffic], states=True)


def python_states(
    firmware: BusFirmware, calibration: Calibration, traffic: EcuTraffic
) -> Iterator[Any]:
    """Yield the record after each tick in CPython, all that it sends taken."""
    loop, ecu = firmware.loop, firmware.record()
    assert loop.init(ecu, calibration) == 0
    for elapsed, frames in traffic.by_tick():
        for frame in frames:
            payload = frame["payload"].tolist()
            loop.receive(ecu, int(frame["message"]), payload, int(frame["length"]))
        loop.tick(ecu, calibration, elapsed)
        ecu.tx_pending = [0] * len(ecu.tx_pending)
        yield ecu


def compare(firmware: BusFirmware, calibration: Calibration, traffic: EcuTraffic) -> None:
    """Drive both, and compare the records after each tick."""
    run = replayed(native.library_of(firmware), calibration, traffic)
    assert run.states is not None
    for tick, ecu in enumerate(python_states(firmware, calibration, traffic)):
        wanted, found = memory_image.image(ecu), run.states[0, tick].tobytes()
        assert found == wanted, (tick, memory_image.differences(type(ecu), wanted, found))
