"""python-can's interfaces to real buses: options, prerequisites, clock and peculiarities.

Read from the sources of python-can 4.6.1; docs/realtime.md has the same as a table.
"""

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from canroll.errors import CanrollError

KERNEL = "CLOCK_REALTIME of this kernel"
HOST = "this machine's, when the frame is read"
ADAPTER = "the adapter's own"


@dataclass(frozen=True, slots=True)
class CanInterface:
    """One of python-can's interfaces.

    Attributes:
        options: example of options that open it.
        needs: what must be installed or plugged in.
        clock: clock of the time stamps of received frames.
        shared: several programs on one machine can open it at the same time.
        echoes: it echoes sent frames, marked as not received.
        bitrates: supported bit rates, if it silently replaces others; None if it reports them.
    """

    options: str
    needs: str
    clock: str
    shared: bool = False
    echoes: bool = False
    bitrates: tuple[int, ...] | None = None


INTERFACES = {
    "socketcan": CanInterface(
        "-i socketcan -c can0 -b 500000",
        "Linux, and the interface up: sudo ip link set can0 up type can bitrate 500000",
        KERNEL,
        shared=True,
    ),
    "slcan": CanInterface(
        "-i slcan -c /dev/ttyACM0 -b 500000",
        "pyserial: pip install 'python-can[serial]'; on Linux membership of the group dialout",
        HOST,
    ),
    "pcan": CanInterface(
        "-i pcan -c PCAN_USBBUS1 -b 500000",
        "PEAK's driver and PCAN-Basic (libpcanbasic.so, PCANBasic.dll); on Linux the kernel drives "
        "these adapters as -i socketcan without either",
        ADAPTER,
        bitrates=(
            5_000, 10_000, 20_000, 33_000, 47_000, 50_000, 83_000, 95_000, 100_000, 125_000,
            250_000, 500_000, 800_000, 1_000_000,
        ),
    ),
    "kvaser": CanInterface(
        "-i kvaser -c 0 -b 500000",
        "Kvaser's driver with CANlib (libcanlib.so, canlib32.dll); on Linux the kernel drives "
        "these adapters as -i socketcan without it",
        ADAPTER,
        echoes=True,
    ),
    "vector": CanInterface(
        "-i vector -c 0 -b 500000 --bus-kwargs app_name=canroll",
        "Windows, Vector's driver with the XL Driver Library (vxlapi64.dll), and the channel given "
        "to the application in Vector Hardware Config",
        ADAPTER,
    ),
    "gs_usb": CanInterface(
        "-i gs_usb -c 0 -b 500000",
        "gs-usb and libusb: pip install 'python-can[gs-usb]'; on Linux the kernel drives these "
        "adapters as -i socketcan without either",
        ADAPTER,
        echoes=True,
    ),
    "socketcand": CanInterface(
        "-i socketcand -c can0 --bus-kwargs host=192.168.0.10 port=29536",
        "a socketcand server at the other end: 'canroll plant' is one",
        "the server's",
        shared=True,
    ),
    "udp_multicast": CanInterface(
        "-i udp_multicast -c 239.74.163.2 --bus-kwargs port=43113",
        "msgpack: pip install 'python-can[multicast]'",
        KERNEL,
        shared=True,
    ),
}  # fmt: skip
CLASSIFIED = ("socketcan", "gs_usb")
"""Interfaces whose error frames carry the classes of linux/can/error.h."""


def is_shared(name: str) -> bool:
    """Return whether several programs on one machine can open the interface at the same time."""
    return name in INTERFACES and INTERFACES[name].shared


def echoes(name: str) -> bool:
    """Return whether the interface echoes sent frames."""
    return name in INTERFACES and INTERFACES[name].echoes


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach the address or name ``host``."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def clock_of(name: str, bus_kwargs: Mapping[str, Any]) -> tuple[str, bool]:
    """Return the clock of the time stamps, and whether it is comparable with this machine's."""
    if name not in INTERFACES:
        return "unknown", False
    if name == "socketcand" and is_loopback(str(bus_kwargs.get("host", ""))):
        return "CLOCK_REALTIME of the server on this machine", True
    clock = INTERFACES[name].clock
    return clock, clock == KERNEL


def arguments_for(
    name: str,
    channel: str | None,
    bitrate: int | None,
    bus_kwargs: Mapping[str, Any],
) -> dict[str, Any]:
    """Return python-can's arguments, besides the options, with which a loop can use the bus.

    Raises:
        CanrollError: a bit rate that the interface would silently replace.
    """
    known = INTERFACES.get(name)
    if known is not None and known.bitrates and bitrate not in (None, *known.bitrates):
        rates = ", ".join(map(str, known.bitrates))
        raise CanrollError(f"-b {bitrate}: {name} supports {rates}")
    if name == "socketcand":
        return {"tcp_tune": True}
    if name == "gs_usb" and not {"index", "bus", "address"} & set(bus_kwargs):
        # the command line's channel is a text, which python-can takes for no number
        if not (channel or "").isdigit():
            raise CanrollError(f"-c {channel}: gs_usb counts its adapters from 0: -c 0")
        return {"index": int(channel or "")}
    return {}


def driver_is_missing(error: BaseException) -> bool:
    """Return whether an interface could not be opened because its driver or package is missing."""
    text = str(error).lower()
    missing = isinstance(error, (ImportError, NameError)) or "not installed" in text
    return missing or "not been loaded" in text or "library not found" in text
