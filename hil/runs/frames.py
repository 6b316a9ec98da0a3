"""The frames of a run's bus: the ECU's program for them, and what it needs of them."""

from collections.abc import Iterator

from canroll.errors import CanrollError
from codegen.generated.bus_map import VALID_BITS, BusMap, Mailbox, read
from codegen.run.bus_firmware import BusFirmware, built_in, of_bus
from dbc import attribute
from firmware.calibration import Calibration
from firmware.plausibility import NEEDED
from plant_sim.can_bus import BusProfile
from plant_sim.can_bus.own_frames import bus_map, messages_of

DEGRADING = ("vehicle_motion",)
"""Mailboxes without which the loop runs degraded."""


def firmware_of(profile: BusProfile) -> BusFirmware:
    """Return the ECU's program for the frames of a bus."""
    if profile.dbc is None or profile.map_file is None:
        return built_in()
    return of_bus(profile.dbc, profile.map_file)


def refuse_own(profile: BusProfile, command: str) -> None:
    """Raise CanrollError for a bus whose frames only virtual time knows."""
    if profile.dbc is not None:
        raise CanrollError(
            f"'canroll {command}' sends the frames of the bus contract: own frames (--dbc, --map) "
            "are for virtual time, as in 'canroll run'"
        )


def names_of(profile: BusProfile) -> dict[int, str]:
    """Return what the frames of a bus are called, by identifier."""
    return {message.ident: message.name for message in messages_of(profile)}


def check(profile: BusProfile, record: Calibration) -> tuple[str, ...]:
    """Return warnings of what the frames of a bus do to a loop with this calibration.

    Raises:
        CanrollError: a message or signal that the loop cannot do without is missing, or comes less
            often than the loop waits for it.
    """
    bus = bus_map(profile)
    if bus is None:
        return ()
    refuse_wide_steps(bus, record, str(profile.map_file))
    return (*bus.warnings, *_other_rates(profile), *_lacking(profile, bus, record))


def _other_rates(profile: BusProfile) -> Iterator[str]:
    """What the DBC says of the bit rates, where the bus has others."""
    assert profile.dbc is not None
    database, _ = read(profile.dbc)
    for name, rate in (
        ("Baudrate", profile.bitrate),
        ("BaudrateCANFD", profile.data_bitrate or profile.bitrate),
    ):
        said = attribute(database, name)
        if said and said != rate:
            yield f"{profile.dbc}: its {name} is {said} bit/s, that of bus {profile.name} {rate}"


def _lacking(profile: BusProfile, bus: BusMap, record: Calibration) -> Iterator[str]:
    for box, timeout, needed in zip(bus.received, record.timeout_ticks, NEEDED, strict=True):
        if not timeout:
            continue
        where = f"{profile.map_file} [receive.{box.slot}]"
        absent = _absent(box, needed)
        if absent and box.slot not in DEGRADING:
            raise CanrollError(f"{where}: no signal is the {absent}, which this loop needs")
        if absent:
            yield f"{where}: no signal is the {absent}: the loop runs degraded"
        wait = timeout * record.tick_us // 1000
        if box.name and 2 * box.cycle_ms > wait:
            raise CanrollError(
                f"{where}: {box.name} comes every {box.cycle_ms} ms, and the loop gives up after "
                f"{wait} ms: it must come twice in that time"
            )


def _absent(box: Mailbox, needed: int) -> str:
    """The first needed field that no signal of a mailbox is; "" where all are there."""
    there = {signal.place.text for signal in box.signals}
    for bit, field in enumerate(VALID_BITS[box.slot]):
        if needed >> bit & 1 and field not in there:
            return field
    return ""


def refuse_wide_steps(bus: BusMap, record: Calibration, map_file: str) -> None:
    """Raise where a page of a multiplexed frame comes with larger counter steps than accepted."""
    for box, accepted in zip(bus.received, record.e2e_max_delta, strict=True):
        counter = box.protection.counter if box.protection else None
        if record.e2e and counter is not None and box.cycle > accepted:
            raise CanrollError(
                f"{map_file} [receive.{box.slot}]: {box.name} counts over its {box.cycle} pages; "
                f"the calibration accepts steps of {accepted} (e2e_max_delta): raise it, or map a "
                "frame that is not multiplexed"
            )
