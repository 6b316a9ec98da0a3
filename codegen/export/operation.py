"""What an integrator asks of a bundle in operation: fault codes, a silent bus, wear of memory.

All is read from the firmware, its calibration and its bus.
"""

from canroll.codegen.export.contents import Export
from canroll.codegen.export.traceability import requirements
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.memory_image import dtype
from canroll.codegen.run.service import SERVICES
from canroll.codegen.subset.program import Constant, Program
from canroll.firmware.calibration import N_RX, Calibration
from canroll.firmware.security.secoc_state import RESET_MAX
from canroll.firmware.state import N_FAULT_CODES

FAULTS = "plausibility"
"""Module of the firmware that numbers the fault codes."""
BITS = ("LATE", "LACKS")
"""Its tables of fault codes as bits, by received message."""
LIFE_STARTS = 15 * 365 * 10
"""Starts of a car in 15 years at 10 a day: an assumption, to be replaced by the integrator's."""
DRIVE_MIN = 30
"""Minutes of a drive, an assumption too."""
SILENCE = """\
| what happens | what the loop does |
| --- | --- |
{rows}

Nothing in the loop knows of the CAN controller: bus-off and its recovery (128 × 11 recessive
bits) are the driver's. While it is off, no frame arrives, so each message is late after its
timeout, and the mode follows. Frames go on being marked in `tx_pending`; the actuators hold no
moment by a timeout of their own. Before the driver goes back on the bus it must drop what its
mailboxes hold and clear `tx_pending`, so that the first command is a new one.

A slot that is still pending when its next frame is due is overwritten: the newest counts, nothing
queues up, and the counter goes on by one a frame, so that a receiver sees how many are lacking. A
driver that sends from an interrupt copies the payload in the context of the tick."""


def fault_codes(firmware: BusFirmware) -> str:
    """Return the fault codes: name, what sets each, and the requirements that say what follows."""
    program = firmware.program()
    names, setters = _names(program, firmware), _setters(program)
    rows = ["| code | name | set by | requirement |", "| ---: | --- | --- | --- |"]
    asked: dict[str, str] = {}
    for code in range(N_FAULT_CODES):
        keys = setters.get(code, [])
        asked |= {its.name: its.text for its in requirements() if any(map(its.matches, keys))}
        where = ", ".join(f"`{key}`" for key in keys)
        those = ", ".join(its.name for its in requirements() if any(map(its.matches, keys)))
        rows.append(f"| {code} | {names.get(code, '')} | {where} | {those} |")
    return "\n".join([*rows, "", *(f"- {name}: {text}" for name, text in asked.items())])


def _names(program: Program, firmware: BusFirmware) -> dict[int, str]:
    heard = [box.name for box in firmware.bus.received[:N_RX]]
    late = {code: f"{name} late" for code, name in enumerate(heard) if name}
    return late | {
        constant.value: name.removeprefix("FAULT_").replace("_", " ").lower()
        for name, constant in program.modules[FAULTS].constants.items()
        if name.startswith("FAULT_") and isinstance(constant.value, int)
    }


def _setters(program: Program) -> dict[int, list[str]]:
    """The functions that name each fault code, alone or as a bit of a table."""
    setters: dict[int, list[str]] = {}
    for function in program.functions():
        for _, ref in program.references(function):
            if isinstance(ref, Constant) and ref.module == FAULTS:
                for code in _codes(ref):
                    keys = setters.setdefault(code, [])
                    key = ".".join(function.key)
                    keys += [key] if key not in keys else []
    return setters


def _codes(constant: Constant) -> list[int]:
    if constant.name.startswith("FAULT_") and isinstance(constant.value, int):
        return [constant.value]
    if constant.name in BITS and isinstance(constant.value, tuple):
        return [bits.bit_length() - 1 for bits in constant.value if isinstance(bits, int)]
    return []


def silence(record: Calibration, firmware: BusFirmware) -> str:
    """Return what happens where frames do not come, or are not sent."""
    ms = record.tick_us / 1000
    rows = [
        f"| no valid {box.name} for {record.timeout_ticks[slot] * ms:g} ms | fault code {slot} |"
        for slot, box in enumerate(firmware.bus.received[:N_RX])
        if box.name and record.timeout_ticks[slot]
    ]
    trigger = "when its command has moved, at the latest" if record.event_trigger else "at least"
    rows += [
        f"| all good again for {record.recovery_ticks * ms:g} ms | back from SAFE or DEGRADED |",
        f"| a command is due {trigger} after {record.heartbeat_ticks * ms:g} ms | marks its slot |",
        f"| {record.status_ticks * ms:g} ms after the last | marks status and diagnostics |",
    ]
    return SILENCE.format(rows="\n".join(rows))


def wear(export: Export, firmware: BusFirmware) -> str:
    """Return the writes of lasting memory over a car's life; "" where the bundle has none."""
    rows = []
    for name in (name for name in export.services if SERVICES[name].lasting):
        module, _, kind = SERVICES[name].lasting.rpartition(".")
        size = dtype(getattr(firmware.module(module), kind)).itemsize
        rows += [
            _worn(f"`canroll_{name}`, {size} bytes, as power goes", 1),
            _worn(f"the same every minute of a drive of {DRIVE_MIN} min", DRIVE_MIN),
        ]
    if firmware.bus.secured:
        senders = sum(1 for box in firmware.bus.received if box.name)
        rows += [
            _worn("number of this start, 4 bytes, before the first frame", 1),
            _worn(f"`secoc.rx_reset`, 4 bytes for each of {senders} senders that started", senders),
        ]
    if not rows:
        return ""
    lines = [
        "",
        "## Wear of non-volatile memory",
        "",
        f"For {LIFE_STARTS} starts, 15 years at 10 a day; of two places in turn each has half the",
        "writes. Compare the last column with the endurance of your memory, scaled by your starts.",
        "",
        "| write | a start | over all starts | a place, two in turn |",
        "| --- | ---: | ---: | ---: |",
        *rows,
    ]
    if firmware.bus.secured:
        lines += ["", f"The number of starts ends at {RESET_MAX}."]
    return "\n".join([*lines, ""])


def _worn(what: str, writes: int) -> str:
    total = writes * LIFE_STARTS
    return f"| {what} | {writes} | {total} | {-(-total // 2)} |"
