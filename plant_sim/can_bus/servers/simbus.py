"""python-can interface ``simbus``: buses that arbitrate, take time and make errors.

``can.Bus("chassis", interface="simbus", bitrate=500_000)`` is a node on the bus ``chassis`` of
this process; every further one with the same channel is another node. The first decides the bus:

* ``virtual_time=True``: time passes only in ``recv`` and ``let_pass``, deterministically;
* ``data_bitrate``, ``fd``: CAN FD; ``bit_error_rate``: disturbed bits; ``seed``;
* ``traffic``: a ``.dbc`` or ``.toml`` file whose periodic messages are on the bus as well.
"""

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import can
from can.typechecking import AutoDetectedConfig

from canroll.errors import CanrollError
from plant_sim.can_bus.kernel.layout import BUS_OFF, ERROR, ERROR_PASSIVE
from plant_sim.can_bus.kernel.network import NetworkSpec, Segment, build_network, check_frame
from plant_sim.can_bus.servers.hub import Hub, Port
from plant_sim.can_bus.simulation import traffic_spec
from plant_sim.can_bus.traffic.files import load_traffic
from plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, REMOTE

_POLL_S: Final = 0.001


class _Shared:
    """A hub and the settings it was opened with."""

    def __init__(self, hub: Hub, settings: dict[str, Any]) -> None:
        self.hub = hub
        self.settings = settings


_HUBS: Final[dict[str, _Shared]] = {}
_LOCK: Final = threading.Lock()


def _truth(value: Any) -> bool:  # noqa: ANN401
    """Understand booleans as configuration files and command lines give them."""
    return str(value).strip().lower() in {"1", "true", "yes", "on"}


def _open_hub(channel: str, settings: dict[str, Any]) -> Hub:
    shared = _HUBS.get(channel)
    if shared is not None:
        for key, value in settings.items():
            if value is not None and shared.settings[key] not in (None, value):
                raise can.CanInitializationError(
                    f"simbus channel '{channel}' is open with {key}={shared.settings[key]},"
                    f" not {value}"
                )
        return shared.hub
    bitrate = 500_000 if settings["bitrate"] is None else int(settings["bitrate"])
    data_bitrate = int(settings["data_bitrate"] or 0)
    error_rate = float(settings["bit_error_rate"] or 0.0)
    seed = int(settings["seed"] or 0)
    segment = Segment(bitrate, data_bitrate, bit_error_rate=error_rate)
    spec = NetworkSpec(segments=(segment,), nodes=(), seed=seed)
    try:
        if settings["traffic"] is not None:
            traffic = load_traffic(Path(settings["traffic"]), bitrate=bitrate)
            sent = traffic_spec(traffic.messages, bitrate=bitrate, seed=seed)
            spec = NetworkSpec((segment,), sent.nodes, sent.sources, seed=seed)
        network = build_network(spec)
    except CanrollError as error:
        raise can.CanInitializationError(str(error)) from error
    hub = Hub(network, virtual_time=bool(settings["virtual_time"]))
    _HUBS[channel] = _Shared(hub, settings)
    return hub


class SimBus(can.BusABC):
    """One node on a simulated bus; see the module for the options.

    Raises:
        can.CanInitializationError: the channel is open with other settings, or impossible ones.
    """

    def __init__(
        self,
        channel: Any = "simbus0",  # noqa: ANN401
        *,
        bitrate: int | None = None,
        data_bitrate: int | None = None,
        fd: bool = False,
        virtual_time: bool | str | None = None,
        receive_own_messages: bool | str = False,
        bit_error_rate: float | None = None,
        traffic: str | Path | None = None,
        seed: int | None = None,
        can_filters: Any = None,  # noqa: ANN401
        **kwargs: Any,  # noqa: ANN401
    ) -> None:
        settings = {
            "bitrate": None if bitrate is None else int(bitrate),
            "data_bitrate": None if data_bitrate is None else int(data_bitrate),
            "virtual_time": None if virtual_time is None else _truth(virtual_time),
            "bit_error_rate": None if bit_error_rate is None else float(bit_error_rate),
            "traffic": None if traffic is None else str(traffic),
            "seed": None if seed is None else int(seed),
        }
        with _LOCK:
            self.hub = _open_hub(str(channel), settings)
            self.port: Port = self.hub.open_port(receive_own=_truth(receive_own_messages))
        self.channel = str(channel)
        self.channel_info = f"simbus {channel}, node {self.port.node}"
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        self._open = True
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue ``msg`` for arbitration.

        Raises:
            can.CanOperationError: the bus is shut down, the node bus-off, or its queue full for
                longer than ``timeout`` seconds.
        """
        if not self._open:
            raise can.CanOperationError("send on a bus that has been shut down")
        if msg.is_error_frame:
            raise can.CanOperationError("error frames come from errors; they cannot be sent")
        flags = (EXTENDED if msg.is_extended_id else 0) | (REMOTE if msg.is_remote_frame else 0)
        if msg.is_fd:
            flags |= FD | (BIT_RATE_SWITCH if msg.bitrate_switch else 0)
        left = timeout or 0.0
        while True:
            if self.hub.node_state(self.port)[0] == BUS_OFF:
                raise can.CanOperationError(f"{self.channel_info} is bus-off")
            try:
                check_frame(msg.arbitration_id, msg.dlc, flags)
                accepted = self.hub.send(
                    self.port, msg.arbitration_id, flags, msg.dlc, bytes(msg.data or b"")
                )
            except (CanrollError, ValueError) as error:
                raise can.CanOperationError(str(error)) from error
            if accepted:
                return
            if left <= 0.0:
                raise can.CanOperationError("transmit queue full")
            self.hub.let_pass(_POLL_S)
            left -= _POLL_S

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None after ``timeout`` seconds of the bus's own time.

        In virtual time a bus on which nothing will ever happen again returns None at once.
        """
        if not self.hub.virtual_time:
            return super().recv(timeout)
        end = None if timeout is None else self.hub.now_ns() + round(timeout * 1e9)
        while True:
            left = None if end is None else max(0, end - self.hub.now_ns()) * 1e-9
            message, _ = self._recv_internal(left)
            if message is None or self._matches_filters(message):
                return message

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._open:
            raise can.CanOperationError("recv on a bus that has been shut down")
        entry = self.hub.receive(self.port, timeout)
        return (None if entry is None else self._message(entry)), False

    def _message(self, entry: Any) -> can.Message:  # noqa: ANN401
        flags, length = int(entry["flags"]), int(entry["length"])
        broken = entry["outcome"] == ERROR
        remote = bool(flags & REMOTE)
        return can.Message(
            timestamp=self.hub.epoch_s + int(entry["t_received"]) * 1e-9,
            arbitration_id=int(entry["ident"]),
            is_extended_id=bool(flags & EXTENDED),
            is_remote_frame=remote,
            is_error_frame=broken,
            dlc=length,
            data=None if remote else bytes(entry["payload"][:length]),
            is_fd=bool(flags & FD),
            bitrate_switch=bool(flags & BIT_RATE_SWITCH),
            is_rx=entry["sender"] != self.port.node,
            channel=self.channel,
        )

    def let_pass(self, duration_s: float) -> None:
        """Let time pass on the bus: in virtual time at once, else as a sleep."""
        self.hub.let_pass(duration_s)

    @property  # type: ignore[misc]  # python-can lets it be set; the bus alone decides here
    def state(self) -> can.BusState:
        """Error state of the node: active, passive, or error for bus-off."""
        code = self.hub.node_state(self.port)[0]
        if code == BUS_OFF:
            return can.BusState.ERROR
        return can.BusState.PASSIVE if code == ERROR_PASSIVE else can.BusState.ACTIVE

    def shutdown(self) -> None:
        """Leave the bus; the last node to leave ends it."""
        if not getattr(self, "_open", False):
            return
        super().shutdown()
        self._open = False
        with _LOCK:
            if self.hub.close_port(self.port):
                _HUBS.pop(self.channel, None)
                self.hub.stop()

    @staticmethod
    def _detect_available_configs() -> Sequence[AutoDetectedConfig]:
        with _LOCK:
            return [{"interface": "simbus", "channel": channel} for channel in _HUBS]
