"""The firmware of a bus in C for one calibration alone.

Its C leaves the same bytes in the same records as that for any calibration; only the calibration it
was made for starts it, as its CRC is that of the record it is given. CPython runs the source.
"""

from dataclasses import replace
from functools import cache

from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu_traffic import refused
from canroll.codegen.run.memory_image import fill, image
from canroll.firmware.calibration import Calibration


def specialised(firmware: BusFirmware, record: Calibration) -> BusFirmware:
    """Return ``firmware`` for one calibration; services beside the loop stay as they are.

    Raises:
        CanrollError: ``init`` refuses the calibration, or its code is not proved to be safe.
    """
    return _specialised(firmware, image(record))


@cache
def _specialised(firmware: BusFirmware, data: bytes) -> BusFirmware:
    record = Calibration()
    fill(record, data)
    rule = firmware.loop.init(firmware.record(), record)
    if rule:
        raise refused(rule)
    return replace(firmware, calibration=data)
