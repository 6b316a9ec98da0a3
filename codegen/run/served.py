"""A running ECU with the services of its firmware beside the loop."""

from canroll.errors import CanrollError
from codegen.run.backends import Backend, NativeEcu, PythonEcu, open_backend
from codegen.run.bus_firmware import BusFirmware, built_in
from codegen.run.xcp_slave import XcpEcu
from firmware.calibration import Calibration


def open_ecu(name: str, calibration: Calibration, firmware: BusFirmware | None = None) -> Backend:
    """Start an ECU with ``calibration`` and the services of ``firmware`` on the backend ``name``.

    Raises:
        CanrollError: as :func:`codegen.run.backends.open_backend`, or the backend runs no services.
    """
    firmware = firmware or built_in()
    ecu = open_backend(name, calibration, firmware)
    if not firmware.services:
        return ecu
    if not isinstance(ecu, PythonEcu | NativeEcu):
        raise CanrollError(f"--xcp requires --backend native or python, not {name}")
    return XcpEcu(ecu, calibration, firmware)
