"""Random instructions of Thumb on an emulator: registers and flags are what the model says."""

import random

import capstone
import pytest

from canroll.codegen.worst_case.arithmetic import compute
from canroll.codegen.worst_case.conditions import OPPOSITE, where
from canroll.codegen.worst_case.machine_state import I32, MachineState, Value
from canroll.codegen.worst_case.transfer import BRANCHES

SCRATCH = 0x2000_2000
COMPARED = bytes.fromhex("8842")
"""cmp r0, r1"""
N, Z, C, V = (1 << bit for bit in (31, 30, 29, 28))
HOLDS = {
    "EQ": lambda f: f & Z, "NE": lambda f: not f & Z, "HS": lambda f: f & C,
    "LO": lambda f: not f & C, "MI": lambda f: f & N, "PL": lambda f: not f & N,
    "HI": lambda f: f & C and not f & Z, "LS": lambda f: not f & C or f & Z,
    "GE": lambda f: bool(f & N) == bool(f & V), "LT": lambda f: bool(f & N) != bool(f & V),
    "GT": lambda f: not f & Z and bool(f & N) == bool(f & V),
    "LE": lambda f: f & Z or bool(f & N) != bool(f & V),
}  # fmt: skip
CONDITIONS = {getattr(capstone.arm, f"ARM_CC_{name}"): holds for name, holds in HOLDS.items()}


def decoder():
    made = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    made.detail = True
    return made


def encodings(rng):
    """Endless random code of one instruction: shifts, sums, moves, fields, products, logic."""
    while True:
        low = rng.getrandbits(16)
        form = rng.randrange(6)
        if form == 0:  # shift, add, subtract, move, compare, data processing
            yield rng.randrange(0x4500).to_bytes(2, "little")
        elif form == 1:  # extend
            yield (0xB200 | low & 255).to_bytes(2, "little")
        else:
            first = {
                2: 0xEA00 | rng.getrandbits(9),  # shifted register
                3: 0xF000 | rng.getrandbits(9) | (low >> 5 & 0x400),  # modified immediate
                4: 0xF200 | rng.getrandbits(9) | (low >> 5 & 0x400),  # plain immediate, field
                5: 0xFA00 | rng.getrandbits(9),  # registers, products
            }[form]
            second = rng.getrandbits(16) & (0x7FFF if form in (3, 4) else 0xFFFF)
            yield first.to_bytes(2, "little") + second.to_bytes(2, "little")


def usable(insn):
    """Whether an instruction touches registers and flags only, and no sp or pc."""
    regs = {insn.reg_name(r) for r in (*insn.regs_access()[0], *insn.regs_access()[1])}
    named = {insn.reg_name(o.reg) for o in insn.operands if o.type == capstone.arm.ARM_OP_REG}
    memory = any(o.type == capstone.arm.ARM_OP_MEM for o in insn.operands)
    system = insn.insn_name() in ("bkpt", "udf", "mrs", "msr", "cps", "svc", "adr", "clrex")
    return (
        insn.id not in BRANCHES and not memory and not system and not (regs | named) & {"sp", "pc"}
    )


class Machine:
    """A Cortex-M4 that runs a comparison and one instruction."""

    def __init__(self):
        unicorn = pytest.importorskip("unicorn", reason="needs canroll[target]")
        names = unicorn.arm_const
        self.unknown = unicorn.UcError
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(names.UC_CPU_ARM_CORTEX_M4)
        self.uc.mem_map(SCRATCH, 0x1000)
        self.numbers = [names.UC_ARM_REG_R0 + k for k in range(13)] + [names.UC_ARM_REG_LR]
        self.flags = names.UC_ARM_REG_APSR

    def run(self, code, values):
        """Registers and flags after it; None where the processor has no such instruction."""
        self.uc.mem_write(SCRATCH, COMPARED + code + bytes.fromhex("00bf"))
        for number, value in zip(self.numbers, values, strict=True):
            self.uc.reg_write(number, value & 0xFFFFFFFF)
        try:
            self.uc.emu_start(SCRATCH | 1, SCRATCH + len(COMPARED + code))
        except self.unknown:
            return None
        registers = [self.uc.reg_read(number) for number in self.numbers]
        return [v - (1 << 32) * (v >> 31) for v in registers], self.uc.reg_read(self.flags)


def interval(rng, value):
    slack = rng.choice([0, 0, 1, 3, 300, 1 << 20, 1 << 32])
    return Value(max(value - slack, I32.lo), min(value + rng.choice([slack, 0]), I32.hi))


def tried(machine, thumb, rng, code):
    """Whether a code is an instruction; what it leaves lies in what the model says of it."""
    insns = list(thumb.disasm(code, SCRATCH))
    if len(insns) != 1 or insns[0].size != len(code) or not usable(insns[0]):
        return False
    insn = insns[0]
    values = [rng.getrandbits(rng.randint(1, 32)) * rng.choice((1, 1, -1)) for _ in range(14)]
    values = [(v + (1 << 31)) % (1 << 32) - (1 << 31) for v in values]
    after = machine.run(code, values)
    if after is None:
        return False
    state = MachineState.start(0)
    places = [*range(13), 14]
    for k, value in zip(places, values, strict=True):
        state.registers[k] = interval(rng, value)
    for each in (next(thumb.disasm(COMPARED, SCRATCH)), insn):
        compute(state, each, each.insn_name())
    what = f"{insn.mnemonic} {insn.op_str} of {values}"
    kept(state, places, after[0], what)
    for condition in OPPOSITE:
        if CONDITIONS[condition](after[1]):
            branch = where(state.copy(), condition)
            assert branch is not None, (what, condition)
            kept(branch, places, after[0], (what, condition))
    return True


def kept(state, places, values, what):
    for k, value in zip(places, values, strict=True):
        known = state.registers[k]
        assert known.lo <= value <= known.hi, (what, k, value, str(known))
        assert I32.lo <= known.lo <= known.hi <= I32.hi, (what, k, str(known))


@pytest.mark.parametrize("count", [1000, pytest.param(100_000, marks=pytest.mark.long)])
def test_registers_and_flags_lie_in_what_is_stated(count):
    machine, thumb, rng, compared = Machine(), decoder(), random.Random(count), 0
    codes = encodings(rng)
    while compared < count:
        compared += tried(machine, thumb, rng, next(codes))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (Value(-5, 10), Value(0, 0x7FFF)),
        (Value(-5, -1), Value(0, 0x7FFF)),
        (Value(3, 10), Value(3, 10)),
    ],
)
def test_a_field_of_a_negative_number_is_not_negative(before, after):
    ubfx = bytes.fromhex("c0f30e00")  # r0, r0, #0, #15
    assert done(ubfx, before).registers[0] == after


def test_a_product_is_known_with_what_is_added():
    mla = bytes.fromhex("00fb0000")  # r0, r0, r0, r0
    assert done(mla, Value(2, 5)).registers[0] == Value(6, 30)


@pytest.mark.parametrize("code", ["90ea010f", "10f1000f"], ids=["teq r0, r1", "cmn r0, #0"])
def test_flags_that_are_not_modelled_are_not_those_of_before(code):
    assert done(bytes.fromhex(code), Value(0, 0)).flags is None


def test_a_number_saturated_to_no_bits_is_zero():
    assert done(bytes.fromhex("80f30000"), Value(3, 10)).registers[0] == Value(0, 0)


def done(code, before):
    """The state after a comparison and one instruction."""
    state = MachineState.start(0)
    state.set(0, before)
    for insn in decoder().disasm(COMPARED + code, SCRATCH):
        compute(state, insn, insn.insn_name())
    return state
