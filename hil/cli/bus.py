"""``canroll bus``: load, worst-case and simulated response times, a server for a traffic set."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import replace

from rich.console import Console

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from firmware.services.xcp_state import N_ODT
from hil.cli import terminal
from hil.cli.bus_parsers import COMMANDS, SENSOR
from hil.cli.options import refuse_useless
from hil.cli.terminal import show_warnings
from hil.realtime.hardware.interfaces import is_loopback
from hil.report import network_bus, recorded_bus
from hil.report.bus_answer import Answer, Delay, as_json, check_simulation, is_late, show
from hil.report.bus_margins import Margins, margins_json, show_margins
from hil.report.recorded_bus import RecordedAnswer, check_added
from hil.runs.choices import CHOICES, check
from plant_sim.buses import BUSES
from plant_sim.buses.profile import BusProfile
from plant_sim.can_bus.ages import simulate_ages_of_set
from plant_sim.can_bus.analysis import (
    ErrorModel,
    ResponseBound,
    response_bounds,
)
from plant_sim.can_bus.delay_bounds import (
    DelayBounds,
    delay_bounds_of_set,
    in_every_tick,
)
from plant_sim.can_bus.kernel.network import build_network
from plant_sim.can_bus.network_file import is_network, load_profile
from plant_sim.can_bus.own_frames import messages_of, own_messages
from plant_sim.can_bus.proposals import propose_offsets, propose_priorities
from plant_sim.can_bus.recorded_load import effects, joined, missing_from
from plant_sim.can_bus.sensitivity import Bounds, breakdown, error_tolerance
from plant_sim.can_bus.servers.frames import Mirror
from plant_sim.can_bus.servers.shared_server import SharedBus
from plant_sim.can_bus.servers.wall_clock import serve_network
from plant_sim.can_bus.simulation import Simulation, simulate, traffic_spec
from plant_sim.can_bus.traffic.files import Traffic, load_traffic
from plant_sim.can_bus.traffic.inference import InferredBus, infer_bus, infer_buses
from plant_sim.can_bus.traffic.log_name import log_name
from plant_sim.can_bus.traffic.log_playback import Recording, load_recording
from plant_sim.can_bus.traffic.log_reader import is_log
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import EXTENDED, FD

MAX_PORT = 65535
OF_A_SET = (
    *("serve", "share", "replay", "period"),
    *("errors-per-second", "propose", "sensitivity", "offsets"),
)
"""Options that logs and networks do not take."""
DEFAULT_BUS = str(CHOICES["bus"].default)
OURS = "canroll"
"""What the messages of the bus contract are called that come onto a recorded bus."""
BESIDE_RECORDING = "no bound: the periods of a recording are unknown"
"""Why there is no bound."""

OF_AN_ANALYSIS = {"offsets": False, "sensitivity": False, "json": False} | dict.fromkeys(
    ("error_interval", "errors_per_second", "propose")
)
"""Options of the bounds, with their defaults."""


def run(args: argparse.Namespace) -> int:
    """Analyse, simulate and print; or serve until interrupted."""
    _split_channel(args)
    _check(args)
    if args.xcp is not None and not 0 <= args.xcp <= N_ODT:
        raise CanrollError(f"--xcp must be 0 to {N_ODT} frames, got {args.xcp}")
    if args.xcp is not None and (is_log(args.file) or not _of_network(args)):
        raise CanrollError("--xcp requires a network or the name of a bus, such as 500k")
    if is_log(args.file):
        return _run_log(args)
    if _of_network(args):
        return _run_network(args)
    if not args.file.suffix and not args.file.exists():
        raise UnknownNameError("bus", str(args.file), BUSES)
    if args.period is not None and args.file.suffix.lower() == ".toml":
        raise CanrollError(f"--period is of messages without a cycle time: set it in {args.file}")
    traffic = load_traffic(
        args.file,
        bitrate=args.bitrate,
        data_bitrate=args.data_bitrate,
        period_ms=args.period,
    )
    if not args.json:
        show_warnings(traffic.warnings)
    _check_path(args, traffic.messages)
    args.command = args.command or _command_among(traffic.messages)
    if not (args.serve is None and args.share is None) and not is_loopback(args.host):
        _say(f"note: anyone who can reach {args.host} can read and write this bus")
    if args.serve is not None:
        _serve(traffic, args)
        return 0
    if args.share is not None:
        _share(traffic, args)
        return 0
    recording = _recording(traffic, args)
    bounds = _bounds(traffic, recording, args)
    margins = _margins(traffic, args)
    answer = Answer(
        args.file.name,
        args.simulate,
        args.sensor,
        args.command,
        args.tick,
        None if args.replay is None else args.replay.name,
        traffic,
        bounds,
        _simulation(traffic, recording, args),
        _delay(traffic, recording, args),
        recording,
    )
    check_simulation(answer)
    if args.json:
        print(json.dumps(as_json(answer) | margins_json(margins), indent=2))
    else:
        show(answer)
        show_margins(margins, Console())
    failed = any((b.bound_ns is None and b.covered) or is_late(b) for b in answer.bounds)
    failed = failed or bool(margins.refused)
    return int(failed or (answer.delay is not None and answer.delay.failed))


def _split_channel(args: argparse.Namespace) -> None:
    """Take channel and bit rates of a log from its name, ``log.blf#channel@bitrate``."""
    log = log_name(str(args.file))
    if log is None:
        return
    for word, stated in zip(("channel", "bitrate", "data_bitrate"), log[1:], strict=True):
        if stated is None:
            continue
        if getattr(args, word) is not None:
            raise CanrollError(f"{args.file} has it in its name: omit --{word.replace('_', '-')}")
        setattr(args, word, stated)
    args.file = log.path


def _of_network(args: argparse.Namespace) -> bool:
    """Whether it is a network, or a set on whose bus our frames are placed."""
    return args.dbc is not None or is_network(str(args.file))


def _run_network(args: argparse.Namespace) -> int:
    """Bound and simulate all messages of a network, over its gateways."""
    profile = load_profile(str(args.file), args.dbc, args.map)
    if args.xcp is not None:
        profile = replace(profile, measured=(args.xcp, args.tick))
    command = args.command or _command_among(messages_of(profile))
    answer = network_bus.analyse(
        profile,
        (args.sensor, command, args.tick),
        errors=_errors(args),
        duration_s=args.simulate,
        seed=args.seed,
        worst_case_lengths=args.worst_case_lengths,
    )
    network_bus.check(answer)
    if args.json:
        print(json.dumps(network_bus.as_json(answer), indent=2))
    else:
        network_bus.show(answer, args.file.name)
    return int(answer.failed)


def _run_log(args: argparse.Namespace) -> int:
    """Infer the messages of a recorded bus, and analyse it without and with additional ones."""
    added = None if args.add is None else load_traffic(args.add).messages
    frames = _frames(args)
    if added is None:
        _check_path(args, own_messages(args.command or _default_command(frames), frames))
    else:
        _check_path(args, added)
    options = {
        "bitrate": args.bitrate,
        "data_bitrate": args.data_bitrate,
        "section": args.section,
    }
    with terminal.progress(quiet=args.json) as progress:
        if args.channel is None:
            buses = infer_buses(args.file, progress=progress, **options)
        else:
            buses = [infer_bus(args.file, channel=args.channel, progress=progress, **options)]
    answers = []
    for bus in buses:
        answer = _answer_of_log(bus, added, frames, args)
        check_added(answer)
        answers.append(answer)
    if args.json:
        channels = {answer.bus.channel: recorded_bus.as_json(answer) for answer in answers}
        print(json.dumps({"channels": channels}, indent=2))
    else:
        for answer in answers:
            recorded_bus.show(answer)
    return int(any(answer.failed for answer in answers))


def _answer_of_log(
    bus: InferredBus,
    added: Sequence[BusMessage] | None,
    frames: BusProfile | None,
    args: argparse.Namespace,
) -> RecordedAnswer:
    """Analyse one channel without and with messages; None: with ours, in ``frames``."""
    if added is None:
        command = args.command or _recorded_command(bus, frames)
        source = OURS
        messages: Sequence[BusMessage] = own_messages(command, frames)
    else:
        command = args.command or _command_among(added)
        source, messages = args.add.name, added
    more = missing_from(bus, messages)
    delay = None
    if {args.sensor, command} <= {message.name for message in messages}:
        delay = delay_bounds_of_set(
            joined(bus, messages),
            args.sensor,
            command,
            tick_ms=args.tick,
            bitrate=bus.rate.nominal,
            data_bitrate=bus.rate.data,
            errors=_errors(args),
        )
        more = in_every_tick(more, command, tick_ms=args.tick)
    simulation = None
    if args.simulate > 0.0 and more:
        simulation = simulate(
            more,
            bitrate=bus.rate.nominal,
            duration_s=args.simulate,
            data_bitrate=bus.rate.data,
            seed=args.seed,
            worst_case_lengths=args.worst_case_lengths,
            recording=bus.recording,
        )
    return RecordedAnswer(
        args.file.name,
        bus,
        source,
        more,
        effects(bus, more, errors=_errors(args)),
        (args.sensor, command, args.tick),
        delay,
        simulation,
    )


def _command_among(messages: Sequence[BusMessage]) -> str:
    """Return the actuators' command among messages, the default one where there is none."""
    names = {message.name for message in messages}
    return next((name for name in COMMANDS if name in names), COMMANDS[0])


def _frames(args: argparse.Namespace) -> BusProfile | None:
    """Return a bus with the frames of --dbc and --map; None for those of the contract."""
    return None if args.dbc is None else load_profile(DEFAULT_BUS, args.dbc, args.map)


def _default_command(frames: BusProfile | None) -> str:
    return COMMANDS[0] if frames is None else _command_among(messages_of(frames))


def _recorded_command(bus: InferredBus, frames: BusProfile | None) -> str:
    """Return our command that is on a recorded bus, the default one where there is none."""
    ours = messages_of(BUSES[DEFAULT_BUS] if frames is None else frames)
    for name in COMMANDS:
        command = [m for m in ours if m.name == name]
        if command and not missing_from(bus, command):
            return name
    return _default_command(frames)


def _margins(traffic: Traffic, args: argparse.Namespace) -> Margins:
    """Compute the requested margins."""
    bitrate, data_bitrate = traffic.bitrate, traffic.data_bitrate
    messages, rate = traffic.messages, args.errors_per_second

    def bounded(offsets: bool) -> Bounds:
        return lambda chosen, errors: response_bounds(
            chosen,
            bitrate=bitrate,
            data_bitrate=data_bitrate,
            errors=errors,
            offsets=offsets,
        )

    bounds = bounded(args.offsets)
    proposal, refused = None, ""
    try:
        if args.propose == "priorities":
            proposal = propose_priorities(messages, bounds)
        elif args.propose == "offsets":
            proposal = propose_offsets(messages, bounded(offsets=True))
    except VerdictError as error:
        refused = str(error)
    return Margins(
        breakdown(messages, bounds, bitrate=bitrate, data_bitrate=data_bitrate)
        if args.sensitivity
        else None,
        rate,
        () if rate is None else error_tolerance(messages, bounds, errors_per_s=rate),
        args.propose,
        proposal,
        bounds(messages, None) if proposal else (),
        refused,
    )


def _check_path(args: argparse.Namespace, messages: Sequence[BusMessage]) -> None:
    """Reject sensor and command names that are not messages, unless they are the defaults."""
    known = [message.name for message in messages]
    for option, default in (("sensor", SENSOR), ("command", None)):
        name = getattr(args, option)
        if name != default and name not in known:
            raise UnknownNameError(f"--{option} message", name, known)


def _check(args: argparse.Namespace) -> None:
    for option in ("simulate", "tick", "period", "error_interval", "errors_per_second"):
        value = getattr(args, option)
        least = 0.0 if option == "simulate" else 1e-3
        if value is not None and not (value >= least and math.isfinite(value)):
            raise CanrollError(
                f"--{option.replace('_', '-')} must be at least {least:g}, got {value:g}"
            )
    if args.serve is not None and not 0 <= args.serve <= MAX_PORT:
        raise CanrollError(f"--serve {args.serve}: the port must be 0 to {MAX_PORT}")
    if (args.share is None) != (args.programs is None):
        raise CanrollError("--share and --programs require each other")
    if args.programs is not None and args.programs < 1:
        raise CanrollError(f"--programs must be at least 1, got {args.programs}")
    if args.share is not None and not 0 <= args.share <= MAX_PORT:
        raise CanrollError(f"--share {args.share}: the port must be 0 to {MAX_PORT}")
    if args.mirror is not None and args.share is None:
        raise CanrollError("--mirror shows a shared bus: --share is required")
    if args.serve is not None and args.share is not None:
        raise CanrollError("--serve and --share exclude each other")
    if args.serve is not None and args.replay is not None:
        raise CanrollError(
            "--serve and --replay exclude each other: the served bus carries only the set"
        )
    if args.share is None:
        refuse_useless(args, {"pace": "lockstep"}, "it belongs to --share")
    if args.serve is None and args.share is None:
        refuse_useless(args, {"host": "127.0.0.1"}, "it belongs to --serve and --share")
    else:
        refuse_useless(args, OF_AN_ANALYSIS, "a served bus is not analysed")
    if args.replay is not None and args.simulate <= 0.0:
        raise CanrollError("--replay needs --simulate above 0")
    recorded = is_log(args.file)
    network = not recorded and _of_network(args)
    if args.channel is not None and args.replay is None and not recorded:
        raise CanrollError("--channel selects a channel of a log: --replay is required")
    if args.section is not None and args.replay is None and not recorded:
        raise CanrollError("--section selects a section of a log: --replay is required")
    if args.add is not None and not recorded:
        raise CanrollError(f"--add puts messages onto the bus of a log, {args.file} is none")
    for option in OF_A_SET:
        given = getattr(args, option.replace("-", "_")) not in (None, False)
        if given and (recorded or network):
            what = "bus log" if recorded else "network"
            raise CanrollError(f"--{option} needs a traffic set: {args.file} is a {what}")
    check({"dbc": args.dbc, "map": args.map})
    if args.dbc is not None and args.add is not None:
        raise CanrollError("--dbc and --add both say what comes onto the bus: omit one")
    for option in ("bitrate", "data-bitrate"):
        if network and getattr(args, option.replace("-", "_")) is not None:
            raise CanrollError(f"--{option} is that of the network: set it in {args.file}")


def _serve(traffic: Traffic, args: argparse.Namespace) -> None:
    fd = ", ".join(m.name for m in traffic.messages if m.flags & FD)
    if fd:
        raise CanrollError(
            f"--serve: socketcand has no CAN FD frames, python-can's client neither, so {fd} would "
            "be missing: use --share --programs N (interface=simbus_shared)"
        )
    spec = traffic_spec(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
    )
    serve_network(build_network(spec), host=args.host, port=args.serve, announce=_say)


def _share(traffic: Traffic, args: argparse.Namespace) -> None:
    """Serve the set to programs in lock step until the last one disconnects."""
    spec = traffic_spec(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
    )
    mirror = None if args.mirror is None else Mirror(args.mirror)
    bus = SharedBus(
        build_network(spec),
        programs=args.programs,
        host=args.host,
        port=args.share,
        real_time=args.pace == "realtime",
        mirror=mirror,
    )
    host, port = bus.address
    _say(f"waiting for {args.programs} programs: interface=simbus_shared, channel={host}:{port}")
    try:
        _say(f"the last program left after {bus.run() * 1e-9:g} s of bus time")
    except KeyboardInterrupt:
        _say("stopped")
    finally:
        if mirror is not None:
            mirror.close()
            if mirror.failed:
                _say(f"{args.mirror} did not accept {mirror.failed} frames")


def _say(text: str) -> None:
    print(text, flush=True)


def _recording(traffic: Traffic, args: argparse.Namespace) -> Recording | None:
    if args.replay is None:
        return None
    with terminal.progress(quiet=args.json) as progress:
        return load_recording(
            args.replay,
            bitrate=traffic.bitrate,
            data_bitrate=traffic.data_bitrate,
            leave_out={(m.ident, bool(m.flags & EXTENDED)) for m in traffic.messages},
            channel=args.channel,
            section=args.section,
            progress=progress,
        )


def _bounds(
    traffic: Traffic, recording: Recording | None, args: argparse.Namespace
) -> list[ResponseBound]:
    bounds = response_bounds(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        errors=_errors(args),
        offsets=args.offsets,
    )
    if recording is None:
        return bounds
    return [
        b
        if b.bound_ns is None
        else replace(b, bound_ns=None, reason=BESIDE_RECORDING, covered=False)
        for b in bounds
    ]


def _errors(args: argparse.Namespace) -> ErrorModel | None:
    interval_ms: float | None = args.error_interval
    return None if interval_ms is None else ErrorModel(round(interval_ms * 1e6))


def _simulation(
    traffic: Traffic, recording: Recording | None, args: argparse.Namespace
) -> Simulation | None:
    if args.simulate <= 0.0:
        return None
    return simulate(
        traffic.messages,
        bitrate=traffic.bitrate,
        duration_s=args.simulate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
        worst_case_lengths=args.worst_case_lengths,
        recording=recording,
    )


def _delay(traffic: Traffic, recording: Recording | None, args: argparse.Namespace) -> Delay | None:
    """Bounds of the total delay from sensor to command, and simulated ages; None without both."""
    path = args.sensor, args.command
    if not {args.sensor, args.command} <= {message.name for message in traffic.messages}:
        return None
    bounds = delay_bounds_of_set(
        traffic.messages,
        *path,
        tick_ms=args.tick,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        errors=_errors(args),
    )
    reason, failed = "", False
    if isinstance(bounds, ResponseBound):
        reason, failed = f"{bounds.message.name}: {bounds.reason}", bounds.covered
    elif recording is not None:
        reason = BESIDE_RECORDING
    limits = bounds if isinstance(bounds, DelayBounds) and not reason else None
    ages = simulate_ages_of_set(
        traffic.messages,
        *path,
        tick_ms=args.tick,
        duration_s=args.simulate,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
        worst_case_lengths=args.worst_case_lengths,
        recording=recording,
    )
    if not len(ages):
        return Delay(limits, reason, failed, math.nan, math.nan)
    return Delay(limits, reason, failed, float(ages.min()), float(ages.max()))
