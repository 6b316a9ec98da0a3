"""``canroll ecu``: the ECU alone, in real time on any python-can bus, or on a recorded drive."""

import argparse
from dataclasses import asdict
from pathlib import Path

from canroll import dbc, vehicles
from canroll.cli import terminal
from canroll.cli.options import choices_of, chosen_services, folder_of
from canroll.cli.parser import check_mode
from canroll.cli.realtime_parsers import (
    DEFAULT_PHASE_MS,
    DRIVE,
    FREE,
    OF_AN_ECU,
    ON_A_BUS,
    PEER_TIMEOUT,
    TRACE,
)
from canroll.codegen.generated.mailbox_frame import with_signals
from canroll.codegen.run.backends import Backend, default_backend, open_backend
from canroll.codegen.run.bus_firmware import BusFirmware, with_services
from canroll.codegen.run.secured import SecuredEcu
from canroll.codegen.run.services import open_ecu
from canroll.dbc.reader import paths_of
from canroll.errors import CanrollError, VerdictError
from canroll.firmware.event_trigger import command_slot
from canroll.firmware.state import RX_IMU
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.calibration.calibration_file import load as load_calibration
from canroll.hil import ecu_loop, lockstep, process, tick_trace, warm
from canroll.hil.bus_link import CanLink, open_link
from canroll.hil.hardware import bus_record, lasting
from canroll.hil.phase_lock import PhaseLock
from canroll.hil.plant_loop import sent_by, sent_to
from canroll.plant_sim.buses import LOGS
from canroll.plant_sim.can_bus import BusProfile
from canroll.plant_sim.can_bus.network.own_frames import secured
from canroll.plant_sim.can_bus.traffic.log_name import log_name
from canroll.plant_sim.can_bus.traffic.log_reader import read_log, select_channel
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder
from canroll.runs import phase
from canroll.setup.bus_frames import (
    firmware_of,
    profile_of,
    refuse_idle,
    refuse_useless_key,
    secret_of,
    stage_of,
)
from canroll.setup.choice import several
from canroll.studies import recorded_drive
from canroll.studies.recorded_drive_page import drive_page, reception_table
from canroll.studies.recursive_estimate import estimate_table, estimates
from canroll.vehicles import Vehicle

MODES = dbc.names("RollControlStatus", "Mode")
TRACE_SUFFIX = ".npz"
OFF_THE_BUS = {
    ON_A_BUS: "",
    TRACE: "a trace is replayed as it was recorded",
    DRIVE: "a recorded drive has no bus",
}
"""Why options have no effect, by mode."""


def peer_timeout(args: argparse.Namespace) -> float | None:
    """Return the silence after which the other side counts as lost, s; None: wait forever.

    Raises:
        CanrollError: it is negative.
    """
    given = PEER_TIMEOUT[args.pace] if args.peer_timeout is None else args.peer_timeout
    nanoseconds(given, "--peer-timeout")
    return given or None


def nanoseconds(seconds: float | None, option: str) -> int | None:
    """Return a time from the command line in ns; None for 0 and None.

    Raises:
        CanrollError: it is negative.
    """
    if seconds is not None and not seconds >= 0:
        raise CanrollError(f"{option} must be at least 0, got {seconds:g}")
    return round(seconds * 1e9) if seconds else None


def run(args: argparse.Namespace) -> int:
    """Run until stopped, or replay a trace or a recorded drive; 0 unless a trace differs.

    Raises:
        VerdictError: a run in lock step is not one run with one plant; its trace is written.
    """
    backend = args.backend or default_backend()
    profile = profile_of(choices_of(args, OF_AN_ECU))
    check_memory(args, profile)
    key = secret_of(choices_of(args, OF_AN_ECU))
    drive = args.replay is not None and log_name(str(args.replay)) is not None
    if args.replay is not None and not drive and args.replay.suffix.lower() != TRACE_SUFFIX:
        raise CanrollError(
            f"--replay {args.replay}: neither a trace ({TRACE_SUFFIX}) nor a bus log"
            f" ({', '.join(LOGS)}, or these and .gz)"
        )
    mode = ON_A_BUS if args.replay is None else DRIVE if drive else TRACE
    check_mode(args, mode, why=OFF_THE_BUS[mode])
    loaded = None if args.calibration is None else load_calibration(args.calibration)
    stage = stage_of({} if loaded is None else loaded.tables, choices_of(args, OF_AN_ECU))
    services = chosen_services(args)
    firmware = with_services(firmware_of(profile, stage), services)
    if mode == TRACE:
        return replay(args.replay, backend, firmware, key)
    if loaded is None:
        raise CanrollError("--calibration FILE is required; create one with 'canroll design'")
    refuse_idle(firmware.bus, loaded.record, str(profile.map_file))
    if drive:
        return replay_drive(args, loaded, firmware, backend, key)
    duration = nanoseconds(args.duration, "--duration")
    timeout = peer_timeout(args)
    calibration = loaded.record
    lock = phase_lock(args, calibration.tick_us, firmware)
    remembered = lasting.of_ecu(lasting.read(args.memory), firmware)
    ecu = open_ecu(backend, calibration, firmware, key=key, lasting=remembered)
    link = open_link(args, firmware.fd)
    recorder = tick_trace.TickRecorder(room=firmware.room)
    settings = process.paced(args.pace, cpu=args.cpu, priority=process.ECU_PRIORITY)
    with process.stop_on_signals() as stop, settings as notes:
        if args.pace == "realtime":
            warm.rehearse_ecu(open_backend(backend, calibration, firmware), calibration, firmware)
        for note in notes:
            print(f"note: {note}", flush=True)
        _remember(args.memory, ecu, firmware)
        try:
            with warm.counted_compilations() as compiled:
                print(f"ECU runs every {calibration.tick_us / 1000:g} ms", flush=True)
                if args.pace == "realtime":
                    outcome = ecu_loop.run(
                        ecu,
                        link,
                        recorder,
                        calibration,
                        stop=stop,
                        duration_ns=duration,
                        peer_timeout_ns=nanoseconds(timeout, "--peer-timeout"),
                        lock=lock,
                        firmware=firmware,
                    )
                else:
                    outcome = ecu_loop.run_granted(
                        ecu,
                        link,
                        grants_of(args, link, calibration.tick_us, stop, firmware),
                        recorder,
                        calibration,
                        stop=stop,
                        duration_ns=duration,
                        peer_timeout=timeout,
                        firmware=firmware,
                    )
        finally:
            link.close()
            _remember(args.memory, ecu, firmware)
        if lock is not None and not lock.locked:
            notes.append("ticks not locked to the Imu frames: none received, or too irregular")
        if args.trace is not None:
            about = {
                "reason": outcome.reason,
                "not_valid": outcome.not_valid,
                "backend": backend,
                "notes": notes,
                "cpu": args.cpu,
                "sent": link.sent,
                "received": link.received,
                "failed": link.failed,
                "full": recorder.full,
                "compilations": compiled.count,
                "pace": args.pace,
                "bus": bus_record.about_of(link.record),
            }
            if isinstance(ecu, SecuredEcu):
                about |= {
                    "lasting": [remembered.starts, remembered.senders],
                    "not_authentic": ecu.refused,
                }
            trace = tick_trace.TickTrace(
                calibration,
                recorder.ticks(),
                recorder.frames(),
                about,
                bus_record.entries_of(link.record),
            )
            tick_trace.save(args.trace, trace)
    print(
        f"ECU ends ({outcome.reason}) in {MODES[outcome.mode]}: {outcome.ticks} ticks, "
        f"{outcome.misses} missed",
        flush=True,
    )
    if outcome.not_valid:
        raise VerdictError(f"not valid: {outcome.not_valid}")
    return 0


def check_memory(args: argparse.Namespace, profile: BusProfile) -> None:
    """Raise CanrollError for a key or a memory that the bus has no use for."""
    refuse_useless_key(choices_of(args, ("key",)), profile)
    if args.memory is not None and not secured(profile):
        raise CanrollError(
            f"--memory: the frames of bus {profile.name} are not authenticated: omit it"
        )


def _remember(path: Path | None, ecu: Backend, firmware: BusFirmware) -> None:
    if isinstance(ecu, SecuredEcu):
        lasting.write(path, lasting.by_name(ecu.lasting, firmware))


def phase_lock(args: argparse.Namespace, tick_us: int, firmware: BusFirmware) -> PhaseLock | None:
    """Return the phase lock of the ticks; None for free-running ticks.

    Imu frames that come otherwise than those of the bus contract have no phase.

    Raises:
        CanrollError: no phase is possible with this tick, or not this one.
    """
    if args.phase_ms == FREE or args.pace == "lockstep":
        return None
    cycle_ms = firmware.bus.received[RX_IMU].cycle_ms
    if 1_000_000 * cycle_ms != phase.IMU_PERIOD_NS:
        if args.phase_ms is not None:
            raise CanrollError(
                f"Imu frames come every {cycle_ms:g} ms on this bus: a phase is chosen within "
                f"{phase.IMU_PERIOD_NS / 1e6:g} ms; omit --phase"
            )
        return None
    if args.phase_ms is None:
        try:
            cycle = phase.cycle_ns(1000 * tick_us)
        except CanrollError:
            return None
        return PhaseLock(phase_ns=round(1e6 * DEFAULT_PHASE_MS) % cycle, cycle_ns=cycle)
    wanted = round(1e6 * args.phase_ms)
    return PhaseLock(phase_ns=wanted, cycle_ns=phase.checked_cycle_ns(1000 * tick_us, wanted))


def grants_of(
    args: argparse.Namespace,
    link: CanLink,
    tick_us: int,
    stop: process.Stop,
    firmware: BusFirmware,
) -> lockstep.Grants:
    """Return the plant's grants."""
    plants, own = sent_to(firmware), sent_by(firmware)
    channel = lockstep.GrantChannel(
        link, sends=lockstep.ACKNOWLEDGEMENT, hears=lockstep.GRANT, idents=plants | own
    )
    return lockstep.Grants(link, channel, idents=plants, foreign=own, tick_us=tick_us, stop=stop)


def replay(path: Path, backend: str, firmware: BusFirmware, key: bytes) -> int:
    """Run a trace through a backend and compare every frame it sends.

    Raises:
        VerdictError: a frame differs.
    """
    trace = tick_trace.load(path)
    again = tick_trace.replay(trace, backend, firmware=firmware, key=key)
    if again.difference is not None:
        raise VerdictError(f"{path}: backend '{backend}' differs: {again.difference}")
    sent = int(trace.frames["sent"].sum())
    print(f"{backend}: {len(trace.ticks)} ticks, {sent} frames, identical byte for byte")
    return 0


def replay_drive(
    args: argparse.Namespace,
    loaded: LoadedCalibration,
    firmware: BusFirmware,
    backend: str,
    key: bytes,
) -> int:
    """Drive the firmware with a bus log and show its response.

    Raises:
        CanrollError: an unreadable log, or none of its frames; no fitted vehicle to compare with.
        VerdictError: a message without any right checksum; all is written.
    """
    fitted = _fitted(args.fitted, loaded)
    out = page_folder(folder_of(args))
    log = log_name(str(args.replay))
    assert log is not None
    channel = getattr(args, "channel", None)
    if channel is not None and log.channel is not None:
        raise CanrollError(f"{args.replay} names a channel: omit --channel")
    database = dbc.load() if args.dbc is None else dbc.read(paths_of(args.dbc))[0]
    box = firmware.bus.transmitted[command_slot(loaded.record)]
    command = database.get_message_by_name(box.name)
    if args.dbc is not None:
        names = {part.name for signal in box.signals for part in signal.parts}
        command = with_signals(command, names, box.sent_length)
    with terminal.progress(quiet=args.json) as progress:
        channels = read_log(log.path, section=args.section, progress=progress)
        logged = select_channel(log.path, channels, channel or log.channel)
        drive = recorded_drive.replay(
            logged,
            loaded.record,
            firmware,
            command,
            backend=backend,
            key=key,
            progress=progress,
        )
    identified = (
        ()
        if drive.ratios is None
        else estimates(drive.ratios, loaded.record, loaded.vehicle, fitted)
    )
    parameters = [
        ("log", str(args.replay)),
        ("calibration", f"{args.calibration} (id {loaded.record.id})"),
        ("bus", ", ".join(several(args.dbc or "canroll's own frames"))),
        ("firmware run by", backend),
    ]
    texts = {"report": (".html", lambda: drive_page(drive, args.replay.name, parameters))}
    about = {"log": str(args.replay), "channel": logged.channel, **drive.to_json()}
    about["identified"] = [asdict(one) for one in identified]
    data = {"files": {}, **write_page(out, "drive", texts, about)}
    parts: list[terminal.Part] = [terminal.verdict(drive.verdict, good=None)]
    parts += [*terminal.warnings(drive.warnings), reception_table(drive)]
    parts += terminal.titled(estimate_table(identified)) if identified else ()
    terminal.emit(args, data, [*parts, *terminal.files(data["files"])])
    refusals = [heard.refusal for heard in drive.receptions if heard.refusal]
    if refusals:
        raise VerdictError("; ".join(refusals))
    return 0


def _fitted(path: str | None, loaded: LoadedCalibration) -> Vehicle | None:
    """Return the vehicle with a fit to compare with: of a file, else of the calibration, or None.

    Raises:
        CanrollError: the file's vehicle has no fit, or the ECU identifies nothing.
    """
    if path is None:
        return None if loaded.vehicle.fit is None else loaded.vehicle
    if not loaded.record.identification:
        raise CanrollError(
            f"--fitted: {loaded.path} does not identify: design it with --identification"
        )
    vehicle = vehicles.load(path)
    if vehicle.fit is None:
        raise CanrollError(f"--fitted: {path} has no [fit]: name the file of 'canroll fit'")
    return vehicle
