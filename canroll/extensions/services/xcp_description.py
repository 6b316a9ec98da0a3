"""The XCP slave in an A2L: its lists of measurements, its pages, and the addresses it goes by."""

from collections.abc import Iterator

from canroll.codegen.export.a2l_xcp import Slave
from canroll.extensions.services.modules import xcp_state
from canroll.extensions.services.running import PAGE_ADDRESS, STATE_ADDRESS

PAGE_ACCESS = "ECU_ACCESS_DONT_CARE XCP_READ_ACCESS_DONT_CARE"


def described(tick_us: int) -> Slave:
    """Return the description of the slave beside a loop with this period, µs."""
    addresses = {"calibration": PAGE_ADDRESS, "ecu": STATE_ADDRESS}
    return Slave(list(_lists(tick_us)), _segment(), addresses)


def _lists(tick_us: int) -> Iterator[str]:
    cycle, unit = (tick_us // 1000, 6) if tick_us % 1000 == 0 else (tick_us // 100, 5)
    yield "      /begin DAQ"
    yield f"        DYNAMIC 0 {xcp_state.N_EVENTS} 0"
    yield "        OPTIMISATION_TYPE_DEFAULT ADDRESS_EXTENSION_FREE"
    yield "        IDENTIFICATION_FIELD_TYPE_ABSOLUTE GRANULARITY_ODT_ENTRY_SIZE_DAQ_BYTE"
    yield f"        {xcp_state.ENTRY_BYTES} OVERLOAD_INDICATION_EVENT"
    yield "        PRESCALER_SUPPORTED"
    yield "        /begin TIMESTAMP_SUPPORTED 1 SIZE_DWORD UNIT_1US /end TIMESTAMP_SUPPORTED"
    for name, number, period in (
        ("tick", xcp_state.EVERY_TICK, f"{cycle} {unit}"),
        ("command", xcp_state.COMMAND_SENT, f"0 {unit}"),
    ):
        yield (
            f'        /begin EVENT "{name}" "{name}" {number} DAQ {xcp_state.N_DAQ} {period} 0 '
            "/end EVENT"
        )
    yield "      /end DAQ"


def _segment() -> str:
    """The block of the calibration's memory segment: its two pages."""
    pages = (
        (xcp_state.REFERENCE, "XCP_WRITE_ACCESS_NOT_ALLOWED"),
        (xcp_state.WORKING, "XCP_WRITE_ACCESS_WITHOUT_ECU_ONLY"),
    )
    inside = " ".join(
        f"/begin PAGE {number} {PAGE_ACCESS} {write} INIT_SEGMENT 0 /end PAGE"
        for number, write in pages
    )
    return f"/begin IF_DATA XCP /begin SEGMENT 0 2 0 0 0 {inside} /end SEGMENT /end IF_DATA"
