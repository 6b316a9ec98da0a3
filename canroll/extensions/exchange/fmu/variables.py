"""Variables and CAN terminals of an FMU, and their table in C."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import prod

FLOAT64, INT32, UINT8, INT64, BOOLEAN = "Float64", "Int32", "UInt8", "Int64", "Boolean"
CLOCK, BINARY = "Clock", "Binary"
OUTPUT, INPUT, PARAMETER, LOCAL, INDEPENDENT = (
    *("output", "input", "parameter", "local"),
    "independent",
)
CODES = {
    FLOAT64: "FMU_FLOAT64",
    INT32: "FMU_INT32",
    UINT8: "FMU_UINT8",
    INT64: "FMU_INT64",
    BOOLEAN: "FMU_BOOLEAN",
}
ACCESS = {PARAMETER: "FMU_PARAMETER", INPUT: "FMU_INPUT"}
MIME_TYPE = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'
RX_CLOCK, RX_DATA, TX_CLOCK, TX_DATA = "Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data"
MEMBERS = {
    RX_CLOCK: "FMU_RX_CLOCK",
    RX_DATA: "FMU_RX_DATA",
    TX_CLOCK: "FMU_TX_CLOCK",
    TX_DATA: "FMU_TX_DATA",
}


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of an FMU; its value reference is its place in the list.

    Attributes:
        name: structured name.
        type: of FMI 3.0.
        causality: output, input, parameter, local or independent.
        member: the place in the C record ``model``; of a terminal's variables empty.
        description: its meaning.
        unit: SI unit, "" for none.
        start: start values, one for each element; none where it is calculated.
        shape: sizes of an array.
        low: least value allowed, or None.
        high: largest value allowed, or None.
        terminal: number of its terminal, −1 for none.
        role: member of the terminal that it is.
    """

    name: str
    type: str
    causality: str
    member: str = ""
    description: str = ""
    unit: str = ""
    start: tuple[float, ...] = ()
    shape: tuple[int, ...] = ()
    low: float | None = None
    high: float | None = None
    terminal: int = -1
    role: str = ""

    @property
    def count(self) -> int:
        """Number of its elements."""
        return prod(self.shape)

    @property
    def variability(self) -> str:
        """When it may change: that of a plain input, and of time, is continuous."""
        if self.causality in (INPUT, INDEPENDENT) and not self.role:
            return "continuous"
        return "fixed" if self.causality == PARAMETER else "discrete"


@dataclass(frozen=True, slots=True, kw_only=True)
class Terminal:
    """A CAN terminal of fmi-ls-bus (low cut).

    Its Tx clock ticks every ``period_ns`` from ``shift_ns`` on; with a period of 0 it counts down
    from event to event.
    """

    name: str
    description: str
    period_ns: int = 0
    shift_ns: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Interface:
    """What importers see of an FMU.

    ``step`` (s) is the communication step that suits it; ``bus`` marks a bus simulation.
    """

    identifier: str
    description: str
    variables: Sequence[Variable]
    terminals: Sequence[Terminal] = ()
    step: float = 0.0
    bus: bool = False
    everything: tuple[Variable, ...] = field(init=False)

    def __post_init__(self) -> None:
        variables = [Variable("time", FLOAT64, INDEPENDENT, unit="s"), *self.variables]
        for number, terminal in enumerate(self.terminals):
            variables += terminal_variables(terminal, number)
        object.__setattr__(self, "everything", tuple(variables))

    def reference(self, name: str) -> int:
        """Return the value reference of a variable."""
        return next(k for k, its in enumerate(self.everything) if its.name == name)


def terminal_variables(terminal: Terminal, number: int) -> Iterator[Variable]:
    """The four variables of a terminal."""
    for role, kind, causality in (
        (RX_CLOCK, CLOCK, INPUT),
        (RX_DATA, BINARY, INPUT),
        (TX_CLOCK, CLOCK, INPUT),
        (TX_DATA, BINARY, OUTPUT),
    ):
        yield Variable(f"{terminal.name}.{role}", kind, causality, terminal=number, role=role)


def table(interface: Interface) -> str:
    """The C source of the table of variables."""
    lines = ["/* The variables, in the order of their value references. */", '#include "fmu.h"', ""]
    lines.append("const fmu_variable fmu_variables[] = {")
    for its in interface.everything:
        if its.causality == INDEPENDENT:
            row = "FMU_TIME, FMU_READ, 1, 0"
        elif its.role:
            row = f"{MEMBERS[its.role]}, FMU_READ, 1, {its.terminal}"
        else:
            access = ACCESS.get(its.causality, "FMU_READ")
            row = f"{CODES[its.type]}, {access}, {its.count}, offsetof(model, {its.member})"
        lines.append(f"    {{ {row} }}, /* {its.name} */")
    lines += ["};", ""]
    lines.append(f"const size_t fmu_variable_count = {len(interface.everything)};")
    return "\n".join([*lines, ""])
