"""What the firmware is offered: the service XCP, diagnostics, and non-volatile memory."""

from canroll.codegen.generated.bus_map import BusMap, frame_ident
from canroll.codegen.run.service import Service

ROOM = "canroll.extensions.services"
MODULES = f"{ROOM}.modules"


def _xcp_master(bus: BusMap) -> int | None:
    return None if bus.xcp is None else frame_ident(bus.xcp.master)


def _uds_request(bus: BusMap) -> int | None:
    return None if bus.uds is None else frame_ident(bus.uds.request)


XCP = Service(
    modules=MODULES,
    records={"xcp": "xcp_state.Xcp", "working": "calibration.Calibration"},
    stores=("law", "calibration_word", "calibration_crc"),
    hears=_xcp_master,
    start=f"{ROOM}.running:Slave",
    session=f"{ROOM}.xcp_session:source",
    note=f"{ROOM}.xcp_session:note",
    tested="| `test/session_xcp.c` | commands of a tool, and the frames that answer them |\n",
    described=f"{ROOM}.xcp_description:described",
)
"""With XCP: measure, calibrate, change pages."""
UDS = Service(
    modules=MODULES,
    records={"uds": "uds_state.Uds"},
    stores=("fault_latched", "fault_count"),
    hears=_uds_request,
    start=f"{ROOM}.running:Server",
    session=f"{ROOM}.uds_session:source",
    note=f"{ROOM}.uds_session:note",
    tested="| `test/session_uds.c` | frames of a tester, and the frames that answer them |\n",
)
"""With diagnostics: fault codes and data by UDS."""
NVM = Service(
    modules=MODULES,
    records={"nvm": "nvm_state.Nvm"},
    stores=("fault_latched", "fault_count", "offset_rate", "offset_acceleration"),
    session=f"{ROOM}.nvm_session:source",
    note=f"{ROOM}.nvm_session:note",
    tested="| `test/session_nvm.c` | what outlives a loss of power: saved, damaged, restored |\n",
    lasting="nvm_state.Nvm",
)
"""With functions that save faults and learnt offsets over a loss of power."""
NVM_UDS = Service(modules=MODULES, needs=("nvm", "uds"))
"""With functions that save the snapshots of diagnostics, too."""
