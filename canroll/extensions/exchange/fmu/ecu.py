"""The ECU as an FMU: the emitted C behind CAN terminals, or with its signals as plain variables.

Parameters are the fields of the calibration, as integers; every field of the state record can be
read. With plain signals the frames exist inside the FMU only, newly packed for every tick and
without end-to-end protection, so that resolution and limits stay those of the bus.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from canroll.codegen.export.header import gains_header
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import EXTENDED, Mailbox
from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.errors import UnknownNameError
from canroll.extensions.exchange.fmu import archive, ecu_signals
from canroll.extensions.exchange.fmu.description import unit_name
from canroll.extensions.exchange.fmu.ecu_signals import Plain
from canroll.extensions.exchange.fmu.variables import (
    FLOAT64,
    INT32,
    LOCAL,
    OUTPUT,
    PARAMETER,
    UINT8,
    Interface,
    Terminal,
    Variable,
)
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import Field, fields

IDENTIFIER = "canroll_ecu"
CAN, SIGNALS = "can", "signals"
PORTS = (CAN, SIGNALS)
"""Kinds of connections: CAN terminals, or plain signals."""
FIXED = ("crc", "tick_us")
"""Fields of the calibration that are no parameters: its seal, and the period of the clock."""
SHOWN: dict[str, tuple[str, int | None, str]] = {
    "roll": ("x", 0, "estimated roll angle"),
    "roll_rate": ("x", 1, "estimated roll rate"),
    "lateral_acceleration": ("x", 2, "estimated lateral acceleration"),
    "moment": ("moment", None, "roll moment wanted by the law"),
    "authority": ("authority", None, "ramp of the command, 0 in SAFE"),
    "mode": ("mode", None, "0 INIT, 1 ACTIVE, 2 DEGRADED, 3 SAFE"),
    "fault_active": ("fault_active", None, "bit i: fault code i is active"),
    "commands_sent": ("commands_sent", None, "commands sent"),
}
"""Outputs by name: field of the state record, its element, meaning."""
_STATES = {0: ("rad", 30), 1: ("rad/s", 27), 2: ("m/s2", 24)}
BUFFER = 8192


def write(
    path: Path,
    firmware: BusFirmware,
    record: Calibration,
    *,
    title: str,
    ports: str = CAN,
    phase_ns: int = 0,
    run_time_ns: int = 200_000,
) -> None:
    """Write the ECU to ``path``.

    Args:
        path: the FMU, replaced if it exists.
        firmware: the firmware for its bus.
        record: the start values of the parameters.
        title: description of the controller, a line.
        ports: ``can`` or ``signals``.
        phase_ns: time from the start to the beginning of tick 0, which is not run.
        run_time_ns: time from a tick to its frames.

    Raises:
        CanrollError: no compiler, an unwritable file, or signals that cannot be plain variables.
    """
    if ports not in PORTS:
        raise UnknownNameError("kind of ports", ports, PORTS)
    bus = firmware.bus
    plain = ecu_signals.of_bus(bus, record) if ports == SIGNALS else None
    terminal = Terminal(
        name="CAN",
        description="frames that the ECU receives and sends",
        period_ns=1000 * record.tick_us,
        shift_ns=phase_ns + run_time_ns,
    )
    interface = Interface(
        identifier=IDENTIFIER,
        description=title,
        variables=[
            *(plain.variables if plain else ()),
            *_shown(firmware),
            *_parameters(record),
            *_states(firmware),
        ],
        terminals=() if plain else (terminal,),
        step=1e-6 * record.tick_us,
    )
    own = ("ecu_signals.c",) if plain else ("ls_bus.h", "ecu_can.c")
    sources = {
        **firmware.files,
        **archive.shell("ecu_model.c", *own),
        "canroll_gains.h": gains_header(record, title=[title]),
        "model.h": _model(plain),
        "ecu_tables.h": _header(bus, plain, phase_ns, run_time_ns),
        "ecu_tables.c": _tables(firmware, plain),
    }
    archive.write(path, interface, sources)


def _parameters(record: Calibration) -> Iterator[Variable]:
    for field in fields(Calibration):
        if field.name not in FIXED:
            start = tuple(np.ravel(np.array(getattr(record, field.name))).tolist())
            variable = _of_field("calibration", field, PARAMETER)
            yield replace(variable, start=start, low=field.f.lo, high=field.f.hi)


def _states(firmware: BusFirmware) -> Iterator[Variable]:
    for field in fields(firmware.record):
        yield _of_field("ecu", field, LOCAL)


def _of_field(record: str, field: Field, causality: str) -> Variable:
    name, kind = f"{record}.{field.name}", UINT8 if field.kind == "u8" else INT32
    parts = [field.f.unit, f"Q{field.f.q}" if field.f.q else "", field.f.meaning]
    meaning = ", ".join(filter(None, parts))
    return Variable(name, kind, causality, name, meaning, shape=field.shape)


def _shown(firmware: BusFirmware) -> Iterator[Variable]:
    known = {its.name: its for its in fields(firmware.record)}
    for number, (name, (field, index, meaning)) in enumerate(SHOWN.items()):
        unit = known[field].f.unit if index is None else _STATES[index][0]
        yield Variable(name, FLOAT64, OUTPUT, f"shown[{number}]", meaning, unit_name(unit))


def _model(plain: Plain | None) -> str:
    wired = archive.WITHOUT_PORTS if plain else {"FMU_PORTS": 1, "FMU_BUFFER": BUFFER}
    lines = [
        "typedef struct {",
        "    canroll_calibration calibration;",
        "    canroll_ecu ecu;",
        "    int64_t start_ns, ticks;",
        f"    double shown[{len(SHOWN)}];",
        *(f"    {member}" for member in (plain.members if plain else ())),
        "} model;",
        "",
    ]
    return archive.model("ECU", "canroll.h", wired, "\n".join(lines))


def _header(bus: BusMap, plain: Plain | None, phase_ns: int, run_time_ns: int) -> str:
    text = (archive.SOURCES / "ecu_tables.h.in").read_text(encoding="utf-8")
    values = {
        "phase_ns": phase_ns,
        "run_time_ns": run_time_ns,
        "received": sum(1 for box in bus.received if box.name),
        "shown": len(SHOWN),
        "signals": plain.header if plain else "",
    }
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", str(value))
    return text


def _tables(firmware: BusFirmware, plain: Plain | None) -> str:
    bus = firmware.bus
    lines = ['#include "ecu_tables.h"', ""]
    received = [(box, slot) for slot, box in enumerate(bus.received) if box.name]
    lines += _frames("ecu_received", "ECU_RECEIVED", received)
    lines += _frames("ecu_sent", "CANROLL_N_TX", [(box, 0) for box in bus.transmitted])
    lines.append("const ecu_word ecu_shown[ECU_SHOWN] = {")
    places: Mapping[str, Any] = memory_image.dtype(firmware.record).fields or {}
    known = {its.name: its for its in fields(firmware.record)}
    for name, (field, index, _) in SHOWN.items():
        its = known[field]
        q = its.f.q if index is None else _STATES[index][1]
        wide = its.kind == "i32"
        offset = int(places[field][1]) + (4 if wide else 1) * (index or 0)
        lines.append(f"    {{ {offset}, {int(wide)}, {2.0**q} }}, /* {name} */")
    lines += ["};", "", *(plain.tables if plain else ())]
    return "\n".join([*lines, ""])


def _frames(name: str, count: str, boxes: Sequence[tuple[Mailbox, int]]) -> Iterator[str]:
    yield f"const ecu_frame {name}[{count}] = {{"
    for box, slot in boxes:
        ident, extended = box.ident & (EXTENDED - 1), int(box.ident & EXTENDED != 0)
        flags = f"{extended}, {int(box.fd)}, {int(box.bit_rate_switch)}"
        length = box.sent_length if box.name else 0
        yield f"    {{ 0x{ident:X}u, {flags}, {length}, {slot} }}, /* {box.name or 'unused'} */"
    yield "};"
    yield ""
