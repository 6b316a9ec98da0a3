"""What the analysis knows of registers holds on an emulated processor; no tick beats its bound."""

import numpy as np
import pytest
from elftools.elf.elffile import ELFFile

from canroll.codegen.operations.intervals import hull
from canroll.codegen.run import cortex, ecu_traffic, memory_image, native
from canroll.codegen.worst_case import firmware_bound as worst
from canroll.codegen.worst_case import library, longest_path
from canroll.codegen.worst_case.cycles import Timing
from canroll.codegen.worst_case.machine_code import SWITCHES, MachineImage
from canroll.codegen.worst_case.machine_state import N_REGISTERS
from canroll.firmware.calibration import PROPAGATED_COVARIANCE, Calibration
from canroll.firmware.state import Ecu

RETURN = 0x2000_3F00


class Machine:
    """An emulated processor with the image of QEMU's replay program in its memory."""

    def __init__(self, image, cpu):
        unicorn = pytest.importorskip("unicorn", reason="needs canroll[target]")
        names = unicorn.arm_const
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(getattr(names, cortex.CPUS[cpu].unicorn))
        self.uc.mem_map(0, 1 << 20)
        self.uc.mem_map(0x2000_0000, 1 << 17)
        with image.open("rb") as file:
            for segment in ELFFile(file).iter_segments():
                if segment["p_type"] == "PT_LOAD":
                    self.uc.mem_write(segment["p_paddr"], segment.data())
        self.code_hook = unicorn.UC_HOOK_CODE
        self.numbers = [names.UC_ARM_REG_R0 + k for k in range(13)]
        self.numbers += [names.UC_ARM_REG_SP, names.UC_ARM_REG_LR]

    def call(self, address, *arguments):
        for number, value in zip(self.numbers, arguments, strict=False):
            self.uc.reg_write(number, value & 0xFFFFFFFF)
        self.uc.reg_write(self.numbers[13], worst.STACK)
        self.uc.reg_write(self.numbers[14], RETURN | 1)
        self.uc.emu_start(address | 1, RETURN)

    def registers(self):
        values = [self.uc.reg_read(number) for number in self.numbers]
        return [value - (1 << 32) if value >> 31 else value for value in values]


def random_state(rng, calibration):
    """An ECU's record of which every field is somewhere in its range, but that has started."""
    library_ = native.library()
    cals = np.frombuffer(memory_image.image(calibration), memory_image.dtype(Calibration), 1)
    record = np.frombuffer(library_.start(cals.copy()).tobytes(), memory_image.dtype(Ecu), 1).copy()
    for field in worst.fields(Ecu):
        if field.name in ("refused", "calibration_word", "calibration_crc"):
            continue
        shape = record[field.name][0].shape
        low, high = field.f.lo, field.f.hi
        near = rng.random() < 0.5
        middle = int(np.clip(0, low, high))
        low, high = (max(low, middle - 50), min(high, middle + 50)) if near else (low, high)
        record[field.name][0] = rng.integers(low, high, shape, np.int64, endpoint=True)
    return record.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    "cpu",
    [
        "cortex-m4",
        *(pytest.param(cpu, marks=pytest.mark.long) for cpu in ("cortex-m0", "cortex-m3")),
    ],
    indirect=True,
)
@pytest.mark.parametrize("seed", [1, *(pytest.param(n, marks=pytest.mark.long) for n in (2, 5))])
def test_registers_lie_in_their_intervals(cpu, seed, monkeypatch):
    calibration = ecu_traffic.random_calibration(seed)
    path = cortex.gcc_image(cpu)
    known = {}

    def remember(self, block, arrival):
        start, now = block.start, arrival.state.registers
        before = known.get(start)
        known[start] = list(now) if before is None else list(map(hull, before, now))
        return visit(self, block, arrival)

    visit = longest_path._Visit.block
    monkeypatch.setattr(longest_path._Visit, "block", remember)
    bound = worst.firmware_bound(calibration, Timing(cpu))
    image, machine = MachineImage(path), Machine(path, cpu)
    ecu, constants = image.address("ecu"), image.address("calibration")
    machine.uc.mem_write(constants, memory_image.image(calibration))
    costs = worst.cycle_costs(path, Timing(cpu))
    summarised = {*library.ROUNDS, *SWITCHES, "__clzdi2", "__clzsi2"}
    wrong, cycles, last = [], [0], [None]

    def look(uc, address, size, data):
        cycles[0] += costs.cycles[address]
        if last[0] in costs.conditional and address != image.instruction(last[0]).size + last[0]:
            cycles[0] += costs.refill
        last[0] = address
        if address in known:
            for register, value in enumerate(machine.registers()):
                interval = known[address][register]
                if not interval.lo <= value <= interval.hi:
                    wrong.append((hex(address), register, value, str(interval)))
        elif image.function(address_of(address)).blocks.get(address) is not None:
            wrong.append((hex(address), "never reached by the analysis"))

    names = sorted(image.functions)

    def address_of(address):
        return max(start for start in names if start <= address)

    def outside(address):
        return image.functions[address_of(address)] in summarised

    machine.uc.hook_add(
        machine.code_hook,
        lambda uc, address, size, data: None if outside(address) else look(uc, address, size, data),
    )
    rng = np.random.default_rng(seed)
    reached = set()
    for _ in range(40):
        machine.uc.mem_write(ecu, random_state(rng, calibration))
        elapsed = int(rng.choice([1, 1, 2, 16, 40, -5, 1 << 30]))
        cycles[0], last[0] = 0, None
        machine.call(image.address("canroll_tick"), ecu, constants, elapsed)
        assert not wrong, wrong[:5]
        assert cycles[0] <= bound.tick.cycles
        reached.add(cycles[0])
    assert len(reached) > 20
    assert len(known) > 300
    assert all(len(registers) == N_REGISTERS for registers in known.values())


@pytest.mark.slow
def test_no_hostile_tick_beats_the_bound(cpu):
    calibration = ecu_traffic.random_calibration(4)
    bound = worst.firmware_bound(calibration, Timing(cpu))
    traffic = ecu_traffic.random_traffic(4, 300, hostile=0.05)
    seen = worst.observe(calibration, traffic, Timing(cpu), 900)
    assert seen.ticks == 900
    assert seen.late > 50
    assert seen.cycles <= bound.tick.cycles
    assert seen.stack <= bound.tick.stack


@pytest.mark.long
def test_a_calibration_excludes_what_it_never_runs(cpu):
    calibrations = [ecu_traffic.random_calibration(seed) for seed in range(8)]
    calibrations.sort(key=lambda record: record.observer == PROPAGATED_COVARIANCE)
    # two that never propagate the covariance, two that do
    bounds = [
        worst.firmware_bound(record, Timing(cpu)).tick
        for record in (*calibrations[:2], *calibrations[-2:])
    ]
    spared = [
        bound.cycles for bound in bounds if "canroll_covariance_propagate" not in bound.shares
    ]
    full = [bound.cycles for bound in bounds if "canroll_covariance_propagate" in bound.shares]
    assert spared
    assert full
    assert max(spared) < min(full)


def test_divisions_take_no_more_rounds_than_stated(cpu):
    path = cortex.gcc_image(cpu)
    image, machine = MachineImage(path), Machine(path, cpu)
    routines = {
        name: image.symbols[name] for name in library.ROUNDS if image.symbols.get(name, (0, 0))[1]
    }
    visits = {}
    machine.uc.hook_add(
        machine.code_hook,
        lambda uc, address, size, data: visits.__setitem__(address, visits.get(address, 0) + 1),
    )
    rng = np.random.default_rng(7)
    edges = [0, 1, 2, 3, 255, 256, (1 << 31) - 1, 1 << 31, (1 << 32) - 1]
    pairs = [(a, b) for a in edges for b in edges[1:]]
    pairs += [
        (
            int(rng.integers(1 << 32)) >> int(rng.integers(32)),
            max(1, int(rng.integers(1 << 32)) >> int(rng.integers(32))),
        )
        for _ in range(300)
    ]
    most = dict.fromkeys(routines, 0)
    for name, (address, size) in routines.items():
        wide = "di" in name[5:] and "idiv" not in name
        for a, b in pairs:
            visits.clear()
            arguments = (a, b) if not wide else (a, a ^ b, b, 0 if a & 1 else b >> 7)
            machine.call(address, *arguments)
            inside = [n for at, n in visits.items() if address <= at < address + size]
            most[name] = max(most[name], *inside)
    assert routines
    for name, visited in most.items():
        assert 1 <= visited <= library.ROUNDS[name]
