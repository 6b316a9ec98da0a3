"""``canroll bus --serve``: a traffic set in real time for other programs."""

import argparse

from canroll.cli import terminal
from canroll.errors import CanrollError
from canroll.hil.hardware.interfaces import is_loopback
from canroll.plant_sim.can_bus.kernel.network import build_network
from canroll.plant_sim.can_bus.servers.wall_clock import serve_network
from canroll.plant_sim.can_bus.simulation.response_times import traffic_spec
from canroll.plant_sim.can_bus.traffic.files import Traffic
from canroll.plant_sim.can_bus.wire.frame import FD


def serve(traffic: Traffic, args: argparse.Namespace) -> None:
    """Run the set in real time.

    Raises:
        CanrollError: it has CAN FD frames, or the port is taken.
    """
    terminal.show(terminal.warnings(traffic.warnings))
    fd = ", ".join(m.name for m in traffic.messages if m.flags & FD)
    if fd:
        raise CanrollError(
            "--serve: neither socketcand nor python-can's client for it supports CAN FD, so"
            f" {fd} would be missing: interface=simbus with traffic={args.file} has them"
        )
    if not is_loopback(args.host):
        _say(f"note: anyone who can reach {args.host} can read and write this bus")
    spec = traffic_spec(
        traffic.messages,
        bitrate=traffic.bitrate,
        data_bitrate=traffic.data_bitrate,
        seed=args.seed,
    )
    serve_network(build_network(spec), host=args.host, port=args.serve, announce=_say)


def _say(text: str) -> None:
    print(text, flush=True)
