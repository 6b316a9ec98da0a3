"""Each instruction of the firmware, alone, on random registers: the interval holds the result."""

import numpy as np
import pytest

from canroll.codegen.run import cortex
from canroll.codegen.worst_case.machine_code import MachineImage
from canroll.codegen.worst_case.machine_state import MachineState, Promises, Value
from canroll.codegen.worst_case.transfer import BRANCHES, Transfer

SCRATCH = 0x2000_2000


def registers_only(insn):
    """Whether an instruction can be run anywhere: no memory, no branch."""
    text = insn.op_str
    return not (
        insn.id in BRANCHES
        or "[" in text
        or "{" in text
        or "pc" in text
        or "sp" in text
        or insn.insn_name() in ("bkpt", "udf", "mrs", "msr")
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "cpu",
    [
        "cortex-m4",
        *(pytest.param(cpu, marks=pytest.mark.long) for cpu in ("cortex-m0", "cortex-m3")),
    ],
    indirect=True,
)
def test_results_lie_in_their_intervals(cpu):
    unicorn = pytest.importorskip("unicorn", reason="needs canroll[target]")
    names = unicorn.arm_const
    path = cortex.gcc_image(cpu)
    image = MachineImage(path)
    uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    uc.ctl_set_cpu_model(getattr(names, cortex.CPUS[cpu].unicorn))
    uc.mem_map(SCRATCH, 0x1000)
    numbers = [names.UC_ARM_REG_R0 + k for k in range(13)] + [
        names.UC_ARM_REG_SP,
        names.UC_ARM_REG_LR,
    ]
    rng = np.random.default_rng(11)
    transfer = Transfer(image, Promises(()), (0, 0))
    tried = set()
    for start in list(image.functions):
        for block in image.function(start).blocks.values():
            for insn in block.instructions:
                code = bytes(insn.bytes)
                if code in tried or not registers_only(insn) or insn.cc not in (0, 15):
                    continue
                tried.add(code)
                uc.mem_write(SCRATCH, code)
                for _ in range(12):
                    bits = rng.integers(1, 32, 15)
                    values = [int(rng.integers(-(1 << b) // 2, 1 << b)) for b in bits]
                    values = [(v + (1 << 31)) % (1 << 32) - (1 << 31) for v in values]
                    slack = [int(rng.choice([0, 0, 1, 300])) for _ in values]
                    state = MachineState.start(0)
                    for k, (value, more) in enumerate(zip(values, slack, strict=True)):
                        uc.reg_write(numbers[k], value & 0xFFFFFFFF)
                        low, high = max(value - more, -(1 << 31)), min(value + more, (1 << 31) - 1)
                        state.registers[k] = Value(low, high)
                    uc.emu_start(SCRATCH | 1, SCRATCH + len(code))
                    transfer.run(state, insn)
                    for k, number in enumerate(numbers):
                        got = uc.reg_read(number)
                        got -= (1 << 32) * (got >> 31)
                        interval = state.registers[k]
                        assert interval.lo <= got <= interval.hi, (
                            insn.mnemonic,
                            insn.op_str,
                            k,
                            got,
                            str(interval),
                        )
    assert len(tried) > 200
