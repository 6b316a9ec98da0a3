"""``canroll bus``: load, worst-case and simulated response times, a server for a traffic set."""

import argparse
import math
from dataclasses import replace

from canroll.cli import terminal
from canroll.cli.bus_parsers import DATABASE, LOG, NETWORK, SET
from canroll.cli.parser import check_mode
from canroll.codegen.generated.bus_map import MOST_LISTED
from canroll.errors import CanrollError, UnknownNameError
from canroll.network.analysis import AnalysisOptions
from canroll.network.recorded import Added, ExtendedLog
from canroll.network.show import parts
from canroll.network.sources import BusNetwork, BusReplay, TrafficSet
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.can_bus.bounds.analysis import ErrorModel
from canroll.plant_sim.can_bus.network.network_file import is_network, load_profile
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.traffic.log_name import LogName, log_name
from canroll.setup.choices import CHOICES, check

MAX_PORT = 65535


def run(args: argparse.Namespace) -> int:
    """Analyse, simulate and print; or serve until interrupted."""
    _check(args)
    source = open_source(args)
    if isinstance(source, TrafficSet) and args.serve is not None:
        # threads, sockets and protocols that nothing else of the command needs
        from canroll.cli.bus_server import serve  # noqa: PLC0415

        serve(source.traffic, args)
        return 0
    with terminal.progress(quiet=args.json) as progress:
        answers = source.analyse(_options(args), progress)
    for answer in answers:
        answer.check()
    shown = (part for answer in answers for part in parts(answer))
    good = not any(answer.failed for answer in answers)
    return terminal.emit(args, source.as_json(answers), shown, good=good)


def open_source(args: argparse.Namespace) -> TrafficSet | BusNetwork | ExtendedLog:
    """Return the log, network or traffic set that FILE names.

    Raises:
        CanrollError: it cannot be read, or an option does not apply to it.
    """
    log = log_name(str(args.file))
    if log is not None:
        return _log(log, args)
    if args.dbc is not None or is_network(str(args.file)):
        return _network(args)
    return _traffic_set(args)


def _log(log: LogName, args: argparse.Namespace) -> ExtendedLog:
    named = log._asdict()
    del named["path"]
    for option, value in named.items():
        given = getattr(args, option)
        if value is not None and given is not None:
            raise CanrollError(f"{args.file} has it in its name: omit {_written(option)}")
        named[option] = given if value is None else value
    check_mode(args, LOG, file=log.path)
    check({"dbc": args.dbc, "map": args.map})
    if args.add is not None and args.dbc is not None:
        raise CanrollError("--dbc and --add both say what comes onto the bus: omit one")
    added = Added("canroll", load_profile(str(CHOICES["bus"].default), args.dbc, args.map))
    if args.add is not None:
        added = replace(added, name=args.add.name, given=load_traffic(args.add).messages)
    return ExtendedLog(log.path, added, section=args.section, **named)


def _network(args: argparse.Namespace) -> BusNetwork:
    check_mode(args, NETWORK, file=args.file)
    check({"dbc": args.dbc, "map": args.map})
    profile = load_profile(str(args.file), args.dbc, args.map)
    if args.xcp is not None:
        profile = replace(profile, measured=(args.xcp, args.tick))
    return BusNetwork(args.file.name, profile)


def _traffic_set(args: argparse.Namespace) -> TrafficSet:
    mode = SET if args.file.suffix.lower() == ".toml" else DATABASE
    # of the log that is replayed
    logs = () if args.replay is None else ("channel", "section")
    check_mode(args, mode, but=logs, file=args.file)
    check({"dbc": args.dbc, "map": args.map})
    if not args.file.suffix and not args.file.exists():
        raise UnknownNameError("bus", str(args.file), BUSES)
    traffic = load_traffic(
        args.file, bitrate=args.bitrate, data_bitrate=args.data_bitrate, period_ms=args.period
    )
    return TrafficSet(
        args.file.name,
        traffic,
        args.offsets,
        args.replay and BusReplay(args.replay, args.channel, args.section),
    )


def _written(option: str) -> str:
    return f"--{option.replace('_', '-')}"


def _options(args: argparse.Namespace) -> AnalysisOptions:
    errors = None
    if args.error_interval is not None:
        errors = ErrorModel(round(args.error_interval * 1e6))
    return AnalysisOptions(
        args.sensor,
        args.command,
        args.tick,
        errors,
        args.simulate,
        args.seed,
        args.worst_case_lengths,
    )


def _check(args: argparse.Namespace) -> None:
    """Refuse values and combinations that no file takes."""
    for option in ("simulate", "tick", "period", "error_interval"):
        value = getattr(args, option)
        least = 0.0 if option == "simulate" else 1e-3
        if value is not None and not (value >= least and math.isfinite(value)):
            raise CanrollError(f"{_written(option)} must be at least {least:g}, got {value:g}")
    if args.xcp is not None and not 0 <= args.xcp <= MOST_LISTED:
        raise CanrollError(f"--xcp must be 0 to {MOST_LISTED} frames, got {args.xcp}")
    if args.replay is not None and args.simulate <= 0.0:
        raise CanrollError("--replay needs --simulate above 0")
    if args.serve is not None and not 0 <= args.serve <= MAX_PORT:
        raise CanrollError(f"--serve {args.serve}: the port must be 0 to {MAX_PORT}")
