"""The bus of python-can's options: opened, and what to do where that fails."""

import argparse
import errno
import socket
from collections.abc import Mapping, Sequence
from typing import Any

import can
from can.cli import add_bus_arguments, create_bus_from_namespace

from canroll.errors import CanrollError, reason
from canroll.hil.hardware import interfaces

__all__ = ["add_bus_arguments", "explain", "has_bus", "open_bus", "options_of", "parsed_options"]

RECEIVE_BUFFER = 1 << 20
"""A raw CAN socket left alone holds 278 frames by default and then drops silently."""

NO_BUS = (
    "-i and -c are required to select the bus, for example -i socketcan -c vcan0 (python-can's "
    "configuration names no interface that it knows)"
)


def has_bus(args: argparse.Namespace) -> bool:
    """Return whether the options or python-can's configuration name an interface.

    Raises:
        CanrollError: none is named, and options of one are given.
    """
    if "interface" in args or _configured():
        return True
    for name in ("channel", "bitrate", "data_bitrate", "fd", "bus_kwargs", "timing"):
        if name in args:
            option = name.replace("_", "-")
            raise CanrollError(f"--{option} is of an interface: add -i, or omit it")
    return False


def parsed_options(options: Sequence[str]) -> argparse.Namespace:
    """Return python-can's options, parsed."""
    parser = argparse.ArgumentParser()
    add_bus_arguments(parser)
    return parser.parse_args(options)


def options_of(args: argparse.Namespace) -> tuple[str, str, int | None, dict[str, Any]]:
    """Return interface, channel, bit rate (None: not given) and arguments of the bus's class.

    Missing options come from python-can's configuration (can.rc, environment).

    Raises:
        CanrollError: neither names an interface.
    """
    configured = {} if "interface" in args else _configured()
    if "interface" not in args and not configured:
        raise CanrollError(NO_BUS)
    name = str(getattr(args, "interface", configured.get("interface", "")))
    channel = getattr(args, "channel", configured.get("channel"))
    bitrate = getattr(args, "bitrate", configured.get("bitrate"))
    kwargs = getattr(args, "bus_kwargs", {})
    return name, str("" if channel is None else channel), bitrate, kwargs


def _configured() -> Mapping[str, Any]:
    """Return python-can's configuration, empty if it names no interface."""
    try:
        return dict(can.util.load_config())
    except can.CanInterfaceNotImplementedError:
        return {}


def open_bus(args: argparse.Namespace) -> can.BusABC:
    """Return the bus that the options describe.

    Raises:
        CanrollError: it cannot be opened; the message names the command that fixes it.
    """
    try:
        name, channel, bitrate, options = options_of(args)
        kwargs = interfaces.arguments_for(name, channel, bitrate, options)
        if name == "socketcand":
            _reachable(str(options.get("host", "")), int(options.get("port", 0)))
        bus = create_bus_from_namespace(args, **kwargs)
    except can.CanInterfaceNotImplementedError as error:
        raise CanrollError(explain(error, args)) from error
    except argparse.ArgumentError as error:
        raise CanrollError(explain(error.__cause__ or error, args)) from error
    raw = getattr(bus, "socket", None)
    if isinstance(raw, socket.socket):
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    return bus


def _reachable(host: str, port: int) -> None:
    if not host or not port:
        raise CanrollError("-i socketcand needs the server: --bus-kwargs host=127.0.0.1 port=29536")
    try:
        socket.create_connection((host, port), timeout=2.0).close()
    except OSError as error:
        raise CanrollError(
            f"no socketcand server at {host}:{port} ({reason(error)}): "
            "start one with 'canroll plant'"
        ) from error


def explain(error: BaseException, args: argparse.Namespace) -> str:
    """Return one line on why a bus could not be opened, and the command that fixes it."""
    interface = getattr(args, "interface", "of can.rc")
    channel = getattr(args, "channel", "")
    number = getattr(error, "errno", None)
    if number == errno.ENODEV:
        return (
            f"no CAN interface '{channel}': 'sudo ip link add dev {channel} type vcan && "
            f"sudo ip link set {channel} up', or put 'scripts/vcan-vm' before the command"
        )
    if number in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return (
            "this kernel has no CAN support: 'sudo modprobe -a can_raw vcan', "
            "or put 'scripts/vcan-vm' before the command"
        )
    if number in (errno.EPERM, errno.EACCES):
        return f"no permission for '{channel}' on {interface}: run as root"
    if "interface" not in args and isinstance(error, can.CanInterfaceNotImplementedError):
        return NO_BUS
    known = interfaces.INTERFACES.get(interface)
    if interfaces.driver_is_missing(error) or isinstance(
        error, can.CanInterfaceNotImplementedError
    ):
        needs = (
            known.needs if known else "its own package or driver (see python-can's documentation)"
        )
        return f"-i {interface} needs {needs} ({_first_line(error)})"
    plugged = f": is it plugged in? It opens as {known.options}" if known else ""
    return f"cannot open '{channel}' on {interface} ({_first_line(error)}){plugged}"


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
