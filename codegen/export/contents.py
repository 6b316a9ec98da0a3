"""Contents of a bundle: what an export is asked for, and the firmware that is made of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from canroll.codegen.export.prefix import DEFAULT
from canroll.codegen.generated.own_stage import OwnStage
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.dbc.reader import Files
from canroll.firmware.calibration import Calibration


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """Contents of a bundle.

    Attributes:
        record: the calibration.
        gains: text of canroll_gains.h.
        title: description of the design in a line or two, for the README.
        dbc: the network description, in one file or several.
        map_file: mapping of signals to fields.
        traffic: frames that the test vectors replay.
        origin: source of the vectors, a sentence for the README.
        stage: the engineer's own stage in the loop, or None.
        specialised: whether the code is for this calibration alone.
        services: modules beside the loop that are part of it.
        byte_order: that of the target's memory, for the A2L: "little" or "big".
        measured: whether the README has figures, for which the code is compiled and analysed.
        prefix: of its public symbols, macros and files.
    """

    record: Calibration
    gains: str
    title: str
    dbc: Files
    map_file: Path
    traffic: EcuTraffic
    origin: str
    stage: OwnStage | None = None
    specialised: bool = False
    services: tuple[str, ...] = ()
    byte_order: str = "little"
    measured: bool = False
    prefix: str = DEFAULT


@dataclass(frozen=True, slots=True)
class Code:
    """The firmware of a bundle.

    Attributes:
        general: for any calibration.
        loop: the same, or specialised.
        served: with the services beside it.
        files: its C, with comments for a reviewer.
    """

    general: BusFirmware
    loop: BusFirmware
    served: BusFirmware
    files: Mapping[str, str]
