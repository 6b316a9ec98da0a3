"""Cycles of each instruction on Cortex-M0, M3 and M4, from Arm's published tables.

Sources: Cortex-M0 technical reference manual (DDI 0432C, table 3-1), Cortex-M3 (DDI 0337I, table
3-1), Cortex-M4 (DDI 0439D, table 3-1). Where a table gives a range (division, long
multiplication, refilling the pipeline), the maximum is taken, so that a sum is an upper bound.
"""

from collections.abc import Callable
from dataclasses import dataclass

from capstone import CsInsn, arm

from canroll.codegen.worst_case.machine_code import conditional, writes_pc
from canroll.errors import CanrollError, UnknownNameError


@dataclass(frozen=True, slots=True)
class Timing:
    """Timing parameters of a processor and its memory.

    Attributes:
        cpu: "cortex-m0", "cortex-m3" or "cortex-m4".
        wait_states: flash wait states for each 32-bit word fetched or read; there is no cache.
        multiplier: cycles of MULS on a Cortex-M0: 1, or 32 for the small one.
        division: maximum cycles of SDIV and UDIV on M3 and M4, 2 to 12.
    """

    cpu: str
    wait_states: int = 0
    multiplier: int = 1
    division: int = 12

    def __post_init__(self) -> None:
        if self.cpu not in TABLES:
            raise UnknownNameError("processor", self.cpu, TABLES)
        if not 0 <= self.wait_states <= 15:
            raise CanrollError(f"--wait-states must be 0 to 15, got {self.wait_states}")
        if self.multiplier not in (1, 32):
            raise CanrollError(f"--multiplier must be 1 or 32 cycles, got {self.multiplier}")
        if not 2 <= self.division <= 12:
            raise CanrollError(f"--division must be 2 to 12 cycles, got {self.division}")

    @property
    def refill(self) -> int:
        """Additional cycles of a conditional branch when it is taken."""
        pipeline = 2 if self.cpu == "cortex-m0" else 3
        return pipeline + 2 * self.wait_states

    def cost(self, insn: CsInsn) -> int:
        """Maximum cycles of an instruction; for a conditional branch, when it is not taken."""
        return TABLES[self.cpu](self, insn) + self.wait_states * self._words(insn)

    def _words(self, insn: CsInsn) -> int:
        """Number of flash words that the instruction newly fetches, and reads as data."""
        first = insn.address // 4 + (insn.address % 4 != 0)
        fetched = (insn.address + insn.size - 1) // 4 - first + 1
        name = insn.insn_name()
        if name in ("ldm", "ldmdb", "pop"):
            return int(fetched + len(insn.operands))
        if name in ("tbb", "tbh", "ldrd"):
            return int(fetched + 2)
        return int(fetched + name.startswith("ldr"))


def _m0(timing: Timing, insn: CsInsn) -> int:
    name = insn.insn_name()
    if name in ("bl", "blx"):
        return 4 + 2 * timing.wait_states
    if name == "pop" and writes_pc(insn):
        return 4 + len(insn.operands) + 2 * timing.wait_states
    if name in ("push", "pop"):
        return 1 + len(insn.operands)
    if name in ("ldm", "stm"):
        return len(insn.operands)
    if conditional(insn):
        return 1
    if writes_pc(insn):
        return 3 + 2 * timing.wait_states
    if name.startswith(("ldr", "str")):
        return 2
    if name == "mul":
        return timing.multiplier
    if name in ("mrs", "msr", "dmb", "dsb", "isb"):
        return 4
    return 1


MULTIPLICATIONS = {
    "cortex-m3": {
        "mul": 1,
        "mla": 2,
        "mls": 2,
        "smull": 5,
        "umull": 5,
        "smlal": 7,
        "umlal": 7,
    },
    "cortex-m4": {
        "mul": 1,
        "mla": 2,
        "mls": 2,
        "smull": 1,
        "umull": 1,
        "smlal": 1,
        "umlal": 1,
    },
}


def _m3(timing: Timing, insn: CsInsn) -> int:
    name = insn.insn_name()
    jump = 3 + 2 * timing.wait_states
    if name in ("bl", "blx"):
        return 1 + jump
    if name in ("tbb", "tbh"):
        return 2 + jump
    if name in ("push", "pop", "ldm", "stm", "ldmdb", "stmdb"):
        listed = len(insn.operands) - (name not in ("push", "pop"))
        return 1 + listed + (jump if writes_pc(insn) else 0)
    if insn.id == arm.ARM_INS_B and conditional(insn):
        return 1
    if name in ("ldrd", "strd"):
        return 3
    if name.startswith(("ldr", "str")):
        return 2 + (jump if writes_pc(insn) else 0)
    if writes_pc(insn):
        return 1 + jump
    if name in ("sdiv", "udiv"):
        return timing.division
    if name in ("mrs", "msr"):
        return 2
    return MULTIPLICATIONS[timing.cpu].get(name, 1)


TABLES: dict[str, Callable[[Timing, CsInsn], int]] = {
    "cortex-m0": _m0,
    "cortex-m3": _m3,
    "cortex-m4": _m3,
}
