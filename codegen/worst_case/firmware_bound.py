"""Bounds of one tick and one received frame of the firmware, and the maximum observed.

Where frames are authenticated, a tick verifies those it received and protects those it sends.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from canroll.codegen.operations.intervals import Value
from canroll.codegen.run import cortex, memory_image, qemu
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.ecu_traffic import EcuTraffic, disturbed, flooded, storm
from canroll.codegen.run.qemu import CycleCosts
from canroll.codegen.worst_case.authentication import Authentication, authentication_bound
from canroll.codegen.worst_case.cycles import Timing
from canroll.codegen.worst_case.longest_path import Bound, LongestPath
from canroll.codegen.worst_case.machine_code import MachineImage, Section
from canroll.codegen.worst_case.machine_state import Area, MachineState, Promises
from canroll.codegen.worst_case.transfer import Transfer
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields

SIZES = {"i32": 4, "u8": 1}


@dataclass(frozen=True, slots=True)
class FirmwareBound:
    """Upper bounds of the two functions called periodically and on reception, on ``timing``.

    ``tick`` contains the ``authentication`` where frames are authenticated; it is None elsewhere.
    """

    timing: Timing
    tick: Bound
    receive: Bound
    authentication: Authentication | None = None


def state_areas(record: type, address: int) -> list[Area]:
    """The memory cells of a state record at ``address`` with the ranges of its field table."""
    layout = memory_image.dtype(record)
    areas = []
    for field in fields(record):
        size, (_, offset) = SIZES[field.kind], layout.fields[field.name][:2]  # type: ignore[index]
        count = 1
        for n in field.shape:
            count *= n
        for k in range(count):
            value = Value(field.f.lo, field.f.hi)
            areas.append(Area(address + offset + size * k, size, value, field.f.volatile))
    return areas


def firmware_bound(
    calibration: Calibration,
    timing: Timing,
    firmware: BusFirmware | None = None,
    *,
    received: int = 0,
) -> FirmwareBound:
    """Bound ``canroll_tick`` and ``canroll_receive`` of a linked image.

    The calibration is constant; the ECU's record may hold any state within its field table, and
    frames and missed ticks are arbitrary.

    Args:
        calibration: the ECU's calibration.
        timing: processor, flash and multiplier.
        firmware: the firmware for a bus, by default the built-in one.
        received: frames that a tick verifies at most, on a bus with authenticated frames.

    Raises:
        CanrollError: the code cannot be bounded.
    """
    firmware = firmware or built_in()
    image = MachineImage(_image(timing, firmware))
    ecu, constants = image.address("ecu"), image.address("calibration")
    image.constant.append(Section(constants, memory_image.image(calibration)))
    records = {ecu: firmware.record}
    if firmware.bus.secured:
        records[image.address("replay_secoc")] = firmware.module("security.secoc_state").Secoc
    areas = [area for at, record in records.items() for area in state_areas(record, at)]
    ends = [at + memory_image.dtype(record).itemsize for at, record in records.items()]
    transfer = Transfer(image, Promises(areas), (min(records), max(ends)))
    analysis = LongestPath(image, transfer, timing)
    start = MachineState.start(STACK)
    start.set(0, Value(ecu, ecu))
    start.set(1, Value(constants, constants))
    marks = _marks(firmware, ecu)
    for mark in marks:
        # what the last tick marked has been sent
        start.store(mark, SIZES["u8"], Value(0, 0))
    tick = analysis.bound("canroll_tick", start)
    start.set(1, Value(-(1 << 31), (1 << 31) - 1))
    receive = analysis.bound("canroll_receive", start)
    if not firmware.bus.secured:
        return FirmwareBound(timing, tick, receive)
    sent = sum(transfer.cell(tick.after, mark, SIZES["u8"]).hi for mark in marks)
    its = authentication_bound(
        analysis, image.address("replay_secoc"), STACK, received=received, sent=sent
    )
    return FirmwareBound(timing, its.around(tick), receive, its)


def _image(timing: Timing, firmware: BusFirmware) -> Path:
    flags = cortex.optimisation_of(firmware)
    return cortex.gcc_image(timing.cpu, firmware.files, optimisation=flags)


def _marks(firmware: BusFirmware, ecu: int) -> list[int]:
    """Addresses of the marks of frames to be sent, where the ECU's record is at ``ecu``."""
    offset = memory_image.dtype(firmware.record).fields["tx_pending"][1]  # type: ignore[index]
    return [ecu + offset + slot for slot, (_, length) in enumerate(firmware.sent) if length]


STACK = 0x2000_4000
"""Where the stack begins; any place apart from the records does."""


@dataclass(frozen=True, slots=True)
class Observed:
    """Maxima over ``ticks`` replayed ticks by the same model, ``late`` of them after misses."""

    cycles: int
    stack: int
    ticks: int
    late: int


def observe(
    calibration: Calibration,
    traffic: EcuTraffic,
    timing: Timing,
    ticks: int,
    *,
    firmware: BusFirmware | None = None,
    received: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Observed:
    """Replay ``traffic``, then hostile variants of it, until ``ticks`` have run in QEMU.

    Frames are lost or corrupted, ticks missed; every second variant is a storm of both. Where
    frames are authenticated, forged ones make them ``received`` a tick. A figure above the bound
    would refute the bound.
    """
    firmware = firmware or built_in()
    costs = cycle_costs(_image(timing, firmware), timing)
    cycles = stack = done = late = 0
    for seed in count():
        if done >= ticks:
            return Observed(cycles, stack, done, late)
        played = traffic
        if seed:
            played = storm(traffic, seed)
            if seed % 2 == 0:
                played = disturbed(traffic, seed, bus=firmware.bus)
            if firmware.bus.secured:
                played = flooded(played, received, len(firmware.bus.received))
        run = qemu.replay(calibration, played, timing.cpu, firmware=firmware, costs=costs)
        assert run.cycles is not None
        cycles, stack = max(cycles, int(run.cycles.max())), max(stack, run.stack)
        late += int((played.elapsed > 1).sum())
        done += played.ticks
        progress(done)
    raise AssertionError


def cycle_costs(path: Path, timing: Timing) -> CycleCosts:
    """The model's cycles for every instruction of an image, for a run on the emulator.

    The replay program's own instructions cost nothing: the figures are those of what it calls.
    """
    image = MachineImage(path)
    cycles, branches = {}, set()
    for address, name in list(image.functions.items()):
        if name == "main" or name.startswith("replay_"):
            continue
        for block in image.function(address).blocks.values():
            for insn in block.instructions:
                cycles[insn.address] = timing.cost(insn)
            if len(block.next) == 2 and block.calls is None and not block.table:
                branches.add(block.last.address)
    return CycleCosts(cycles, frozenset(branches), timing.refill)
