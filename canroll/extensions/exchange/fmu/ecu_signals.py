"""Signals of the ECU's frames as plain variables of its FMU, and their tables in C."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import SAMPLE_COUNTERS, Mailbox
from canroll.codegen.generated.mapped_signal import MappedSignal
from canroll.errors import CanrollError
from canroll.extensions.exchange.fmu.description import unit_name
from canroll.extensions.exchange.fmu.variables import FLOAT64, INPUT, OUTPUT, Variable
from canroll.firmware.calibration import Calibration

ECHO = ("accepted_counter", "command_held")
"""Fields by which the actuators acknowledge commands, which frames without counters need not."""
HEADER = """
#define ECU_INPUTS {inputs}
#define ECU_COUNTERS {counters}
#define ECU_OUTPUTS {outputs}
#define ECU_COMMAND {command}
#define ECU_PIECES {pieces}

/* `width` bits of a signal from `signal_bit` up, in `byte` from `bit` up. */
typedef struct {{
    uint8_t byte, bit, width, signal_bit;
}} ecu_piece;

/* A raw code n stands for `scale` n + `offset`; it lies between `low` and `high`. */
typedef struct {{
    uint8_t frame, sign, length, pieces;
    double scale, offset, low, high;
    ecu_piece piece[ECU_PIECES];
}} ecu_signal;

extern const ecu_signal ecu_inputs[ECU_INPUTS];
extern const double ecu_input_starts[ECU_INPUTS];
extern const ecu_signal ecu_counters[ECU_COUNTERS];
extern const ecu_signal ecu_outputs[ECU_OUTPUTS];
"""


@dataclass(frozen=True, slots=True)
class Plain:
    """Inputs, sample counters and outputs, each with the number of its frame.

    ``command`` is the mailbox of the actuators' command.
    """

    inputs: tuple[tuple[int, Mailbox, MappedSignal], ...]
    counters: tuple[tuple[int, Mailbox, MappedSignal], ...]
    outputs: tuple[tuple[int, Mailbox, MappedSignal], ...]
    command: int

    @property
    def variables(self) -> Iterator[Variable]:
        """The variables of inputs and outputs."""
        for number, (_, box, signal) in enumerate(self.inputs):
            name, unit = f"{box.name}.{signal.name}", unit_name(signal.place.unit)
            meaning, start = f"to {signal.place.text}", (_start(signal),)
            yield Variable(name, FLOAT64, INPUT, f"inputs[{number}]", meaning, unit, start)
        for number, (_, box, signal) in enumerate(self.outputs):
            name, unit = f"{box.name}.{signal.name}", unit_name(signal.place.unit)
            meaning = f"of the last command: {signal.place.text}"
            yield Variable(name, FLOAT64, OUTPUT, f"outputs[{number}]", meaning, unit)

    @property
    def members(self) -> tuple[str, ...]:
        """Members of the model's record."""
        return (f"double inputs[{len(self.inputs)}], outputs[{len(self.outputs)}];",)

    @property
    def header(self) -> str:
        """Declarations of the tables."""
        signals = [signal for _, _, signal in (*self.inputs, *self.counters, *self.outputs)]
        return HEADER.format(
            inputs=len(self.inputs),
            counters=len(self.counters),
            outputs=len(self.outputs),
            command=self.command,
            pieces=max(len(signal.pieces) for signal in signals),
        )

    @property
    def tables(self) -> Iterator[str]:
        """Lines of the tables."""
        yield from _table("ecu_inputs", "ECU_INPUTS", self.inputs)
        starts = ", ".join(str(_start(signal)) for _, _, signal in self.inputs)
        yield f"const double ecu_input_starts[ECU_INPUTS] = {{ {starts} }};"
        yield ""
        yield from _table("ecu_counters", "ECU_COUNTERS", self.counters)
        yield from _table("ecu_outputs", "ECU_OUTPUTS", self.outputs)


def of_bus(bus: BusMap, record: Calibration) -> Plain:
    """Return the plain signals of a bus; sample counters and echoes are made inside the FMU.

    Raises:
        CanrollError: a signal that is more than one number in its frame.
    """
    inputs, counters = [], []
    received = [box for box in bus.received if box.name]
    for frame, box in enumerate(received):
        for signal in box.signals:
            _refuse(box, signal)
            if signal.place.text == SAMPLE_COUNTERS[box.slot]:
                counters.append((frame, box, signal))
            elif signal.place.text not in ECHO:
                inputs.append((frame, box, signal))
    command = int(record.actuator)
    box = bus.transmitted[command]
    for signal in box.signals:
        _refuse(box, signal)
    outputs = tuple((0, box, signal) for signal in box.signals)
    return Plain(tuple(inputs), tuple(counters), outputs, command)


def _start(signal: MappedSignal) -> float:
    return 1.0 if signal.place.text == "enabled" else 0.0


def _refuse(box: Mailbox, signal: MappedSignal) -> None:
    if len(signal.parts) > 1 or signal.real or box.pages:
        raise CanrollError(
            f"{box.name}.{signal.name} has a separate sign, a second signal, a validity or pages, "
            "or is a floating-point number: export it with --ports can"
        )


def _table(
    name: str, count: str, signals: Sequence[tuple[int, Mailbox, MappedSignal]]
) -> Iterator[str]:
    yield f"const ecu_signal {name}[{count}] = {{"
    for frame, box, signal in signals:
        one = 2**signal.place.q
        low, high = signal.raw_lo, signal.raw_hi
        while high in signal.unavailable:
            high -= 1
        while low in signal.unavailable:
            low += 1
        scale, offset = float(signal.scale / one), float(signal.offset / one)
        pieces = ", ".join(
            f"{{ {p.byte}, {p.bit}, {p.width}, {p.signal_bit} }}" for p in signal.pieces
        )
        head = f"{frame}, {int(signal.signed)}, {signal.length}, {len(signal.pieces)}"
        yield f"    /* {box.name}.{signal.name} */"
        yield f"    {{ {head}, {scale!r}, {offset!r}, {low}, {high}, {{ {pieces} }} }},"
    yield "};"
    yield ""
