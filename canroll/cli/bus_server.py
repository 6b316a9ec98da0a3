"""``canroll bus --serve`` and ``--share``: a traffic set for other programs."""

import argparse
import secrets

from canroll.cli import terminal
from canroll.errors import CanrollError
from hil.hardware.interfaces import is_loopback
from plant_sim.can_bus.kernel.network import build_network
from plant_sim.can_bus.servers.frames import Mirror
from plant_sim.can_bus.servers.shared_server import SharedBus
from plant_sim.can_bus.servers.wall_clock import serve_network
from plant_sim.can_bus.simulation.response_times import traffic_spec
from plant_sim.can_bus.traffic.files import Traffic
from plant_sim.can_bus.wire.frame import FD


def serve(traffic: Traffic, args: argparse.Namespace) -> None:
    """Run the set in real time, or for programs in lock step."""
    terminal.show_warnings(traffic.warnings)
    if not is_loopback(args.host):
        who = (
            "anyone who can reach"
            if args.serve is not None
            else "whoever has the token and reaches"
        )
        _say(f"note: {who} {args.host} can read and write this bus")
    fd = ", ".join(m.name for m in traffic.messages if m.flags & FD)
    if fd and args.serve is not None:
        raise CanrollError(
            "--serve: neither socketcand nor python-can's client for it supports CAN FD, so"
            f" {fd} would be missing: use --share --programs N (interface=simbus_shared)"
        )
    spec = traffic_spec(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
    )
    network = build_network(spec)
    if args.serve is not None:
        serve_network(network, host=args.host, port=args.serve, announce=_say)
        return
    mirror = None if args.mirror is None else Mirror(args.mirror)
    # from elsewhere only who has read what is shown here may join
    token = "" if is_loopback(args.host) else secrets.token_hex(8)
    bus = SharedBus(
        network,
        programs=args.programs,
        host=args.host,
        port=args.share,
        real_time=args.pace == "realtime",
        mirror=mirror,
        token=token,
    )
    host, port = bus.address
    options = f"interface=simbus_shared, channel={host}:{port}{token and f', token={token}'}"
    _say(f"waiting for {args.programs} programs: {options}")
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
