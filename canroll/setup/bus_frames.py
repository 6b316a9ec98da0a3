"""The frames of a run's bus: the ECU's program for them, their key, and what they do not carry."""

from collections.abc import Collection, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

from canroll.codegen.generated import own_stage
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import RECEIVED, TRANSMITTED, VALID_BITS
from canroll.codegen.generated.own_stage import OwnStage
from canroll.codegen.run.bus_firmware import BusFirmware, built_in, of_bus, with_stage
from canroll.dbc import attribute, read
from canroll.dbc.keys import DEVELOPMENT_KEY, read_key
from canroll.dbc.reader import each
from canroll.errors import CanrollError
from canroll.firmware import calibration as fw
from canroll.firmware.calibration import Calibration
from canroll.firmware.plausibility import NEEDED
from canroll.firmware.state import (
    REST,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
)
from canroll.gain_gen.laws import WITHOUT_ROLL_RATE
from canroll.plant_sim.can_bus import BusProfile, load_profile
from canroll.plant_sim.can_bus.network.own_frames import bus_map, messages_of, secured
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.setup.choices import chosen

SPEED = 1
"""Bit of ecu.valid: the speed of VehicleMotion."""
STEERED = 3
"""Input of a compensator: the lateral acceleration by steering."""
NAMED = 5
"""Messages that a warning lists."""


def profile_of(choices: Mapping[str, Any]) -> BusProfile:
    """Return the bus for ``choices``, with its frames.

    Raises:
        CanrollError: no such profile, or an unusable file.
    """
    return load_profile(chosen(choices, "bus"), choices.get("dbc"), choices.get("map"))


def firmware_of(profile: BusProfile, stage: OwnStage | None = None) -> BusFirmware:
    """Return the ECU's program for the frames of a bus, with your own stage if one is given."""
    if profile.dbc is None or profile.map_file is None:
        return with_stage(built_in(), stage)
    return with_stage(of_bus(profile.dbc, profile.map_file), stage)


def stage_of(tables: Mapping[str, Any], choices: Mapping[str, Any]) -> OwnStage | None:
    """Return the own stage of a calibration or of ``choices``, checked and proved.

    Raises:
        CanrollError: it cannot be read, or is no stage; both name one.
    """
    stage = own_stage.carried(tables)
    if choices.get("stage") is not None:
        if stage is not None:
            raise CanrollError(
                f"--stage: the calibration carries the stage {stage.file}: omit --stage"
            )
        stage = own_stage.read(Path(choices["stage"]))
    with_stage(built_in(), stage)
    return stage


def names_of(profile: BusProfile) -> dict[int, str]:
    """Return the names of a bus's frames by identifier."""
    return {message.ident: message.name for message in messages_of(profile)}


def check_frames(profile: BusProfile, record: Calibration) -> tuple[str, ...]:
    """Return warnings on the frames of a bus for a loop with this calibration.

    Raises:
        CanrollError: a required message or signal is missing, or its cycle time is longer than the
            loop's timeout for it.
    """
    bus = bus_map(profile)
    background = (*_of_traffic(profile), *profile.warnings)
    if bus is None:
        return background
    refuse_wide_steps(bus, record, str(profile.map_file))
    own = (*bus.warnings, *_other_rates(profile), *_lacking(profile, bus, record))
    return (*own, *background)


def _of_traffic(profile: BusProfile) -> Iterator[str]:
    """What the files of a network's background leave open, or say otherwise."""
    for segment in profile.network.segments:
        if segment.traffic is None:
            continue
        traffic = load_traffic(segment.traffic)
        yield from traffic.warnings
        if traffic.left_out:
            names = ", ".join(traffic.left_out[:NAMED])
            more = len(traffic.left_out) - NAMED
            yield (
                f"{segment.traffic}: no cycle time, so not on the bus: {names}"
                f"{f' and {more} more' if more > 0 else ''}"
            )
        if traffic.rate_assumed and segment.traffic == profile.traffic:
            yield f"{segment.traffic}: says no bit rate; {segment.bitrate} bit/s is assumed"
        elif not traffic.rate_assumed and traffic.bitrate != segment.bitrate:
            yield (
                f"{segment.traffic}: says {traffic.bitrate} bit/s, the network "
                f"{segment.bitrate} bit/s"
            )


def _other_rates(profile: BusProfile) -> Iterator[str]:
    """Warning on the DBC's bit rates if the bus has others."""
    assert profile.dbc is not None
    rates = {
        "Baudrate": profile.bitrate,
        "BaudrateCANFD": profile.data_bitrate or profile.bitrate,
    }
    for path, (name, rate) in product(each(profile.dbc), rates.items()):
        declared = attribute(read(path)[0], name)
        if declared and declared != rate:
            yield f"{path}: its {name} is {declared} bit/s, that of bus {profile.name} {rate}"


def _lacking(profile: BusProfile, bus: BusMap, record: Calibration) -> Iterator[str]:
    """Warnings on what the frames of a bus do not carry; what the loop requires is refused."""
    refuse_idle(bus, record, str(profile.map_file))
    fields = _mapped(bus)
    if "steering" not in fields and _steers(record, fields):
        raise CanrollError(
            f"{profile.map_file} [receive.vehicle_motion]: no signal is mapped to steering, which "
            "this law, observer or learning of offsets requires: choose another"
        )
    for message, timeout in enumerate(record.timeout_ticks):
        slot = RECEIVED[message]
        where = f"{profile.map_file} [receive.{slot}]"
        lacks = absent(bus, message, record)
        watching = message == RX_SUSPENSION_RATE and record.actuator in (fw.SUSPENSION, fw.BARS)
        hint = ": map another, or design with --no-watch-response" if watching else ""
        if lacks == "roll_rate":
            hint = f": map it, or design with --law lqr --observer {WITHOUT_ROLL_RATE[0]}"
        if lacks and watching and not timeout:
            yield (
                f"{where}: no signal is mapped to {lacks}: lying actuators and small errors of "
                "the lateral acceleration go unnoticed"
            )
        if lacks and message == RX_ACTUATOR_STATE and not timeout:
            yield (
                f"{where}: no signal is mapped to {lacks}: what is commanded counts as delivered, "
                "and actuators that fail go unnoticed"
            )
        if not timeout:
            continue
        if lacks:
            raise CanrollError(
                f"{where}: no signal is mapped to {lacks}, which the loop requires{hint}"
            )
        wait = timeout * record.tick_us // 1000
        for box in bus.frames_of(slot):
            if 2 * box.cycle_ms <= wait:
                continue
            slow = (
                f"{where}: {box.name} is sent every {box.cycle_ms} ms, but the loop's timeout "
                f"is {wait} ms: it must be at least two cycle times{hint}"
            )
            if box.bits & (_needed(message, record) | REST):
                raise CanrollError(slow)
            yield f"{slow}; its signals count as late"


def _mapped(bus: BusMap) -> set[str]:
    """The fields that received frames fill."""
    return {signal.place.text for box in bus.received for signal in box.signals}


def _steers(record: Calibration, fields: Collection[str]) -> bool:
    """Whether a calibration uses the steering angle, given the fields that are filled."""
    steered = any(record.gamma_steering) or (
        record.law == fw.COMPENSATOR
        and any(row[STEERED] for row in (*record.compensator_b, *record.compensator_d))
    )
    return steered or (bool(record.offset_learning) and "yaw_rate" not in fields)


def _needed(message: int, record: Calibration | None) -> int:
    """The signals of a message that the loop needs, as bits of ecu.valid."""
    if message == RX_IMU and record is not None:
        return record.measurements or NEEDED[message]
    return NEEDED[message]


def absent(bus: BusMap, message: int, record: Calibration | None = None) -> str:
    """The first required field of a message that no frame of it has; "" if there is none."""
    needed = _needed(message, record)
    if message == RX_VEHICLE_MOTION:
        needed = SPEED
    carried = sum(box.bits for box in bus.frames_of(RECEIVED[message]))
    fields = VALID_BITS[RECEIVED[message]]
    return next((f for k, f in enumerate(fields) if (needed & ~carried) >> k & 1), "")


def refuse_idle(bus: BusMap, record: Calibration, map_file: str) -> None:
    """Raise CanrollError for frames over which a loop with this calibration commands nothing."""
    from canroll.firmware.event_trigger import command_slot  # noqa: PLC0415 - of own frames alone

    slot = command_slot(record)
    if not bus.transmitted[slot].name:
        raise CanrollError(
            f"{map_file}: no [transmit.{TRANSMITTED[slot]}], which commands the actuators of this "
            "calibration: add it, or design with another --actuator"
        )
    if "speed" not in _mapped(bus):
        raise CanrollError(
            f"{map_file} [receive.vehicle_motion]: no signal is mapped to speed: the law commands "
            "nothing without it"
        )


def refuse_wide_steps(bus: BusMap, record: Calibration, map_file: str) -> None:
    """Raise CanrollError if a multiplexed page has larger counter steps than accepted."""
    for box in bus.received:
        accepted = record.e2e_max_delta[RECEIVED.index(box.slot)]
        counter = box.protection.counter if box.protection else None
        if record.e2e and counter is not None and box.cycle > accepted:
            raise CanrollError(
                f"{map_file} [receive.{box.slot}]: {box.name} counts over its {box.cycle} pages; "
                f"the calibration accepts steps of {accepted} (e2e_max_delta): raise it, or map a "
                "frame that is not multiplexed"
            )


def refuse_useless_key(choices: Mapping[str, Any], profile: BusProfile) -> None:
    """Raise CanrollError for a key that cannot be read, or on a bus that uses none."""
    key = choices.get("key")
    if key is None:
        return
    if not secured(profile):
        raise CanrollError(
            f"--key: the frames of bus {profile.name} are not authenticated: omit it, or choose "
            "--bus secured_fd"
        )
    read_key(Path(key))


def secret_of(choices: Mapping[str, Any]) -> bytes:
    """Return the key of authenticated frames for ``choices``.

    Raises:
        CanrollError: the file cannot be read, or holds no key.
    """
    key = choices.get("key")
    return DEVELOPMENT_KEY if key is None else read_key(Path(key))


def refuse_authenticated(profile: BusProfile, command: str) -> None:
    """Raise CanrollError where ``command`` cannot authenticate frames and a bus demands it."""
    if secured(profile):
        raise CanrollError(
            f"{command} cannot authenticate the frames of bus {profile.name}: choose another --bus"
        )
