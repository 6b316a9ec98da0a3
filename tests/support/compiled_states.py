"""A firmware compiled has the states of the same in Python after each tick."""

import numpy as np

from codegen.run import ecu_traffic, memory_image, native
from codegen.run.bus_firmware import BusFirmware
from firmware.calibration import Calibration


def compare(firmware: BusFirmware, cal: Calibration) -> None:
    """Drive both through the same random traffic, and compare the records after each tick."""
    library = native.library_of(firmware)
    cals = np.frombuffer(bytearray(memory_image.image(cal)), memory_image.dtype(Calibration), 1)
    traffic = ecu_traffic.random_traffic(5, 60, bus=firmware.bus)
    run = library.replay(library.start(cals), cals, [traffic], states=True)
    assert run.states is not None
    ecu = firmware.record()
    assert firmware.loop.init(ecu, cal) == 0
    for t in range(traffic.ticks):
        for event in traffic.frames[traffic.frames["tick"] == t]:
            payload, length = event["payload"].tolist(), int(event["length"])
            firmware.loop.receive(ecu, int(event["message"]), payload, length)
        firmware.loop.tick(ecu, cal, int(traffic.elapsed[t]))
        ecu.tx_pending = [0] * 6
        assert memory_image.image(ecu) == run.states[0, t].tobytes(), t
