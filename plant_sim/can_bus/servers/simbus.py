"""python-can interface ``simbus``: a bus with arbitration, transmission times and errors.

``can.Bus("chassis", interface="simbus", bitrate=500_000)`` is a node on the bus ``chassis`` of
this process; every further one with the same channel is another node. The first decides the bus:

* ``virtual_time=True``: time passes only in ``recv``, ``let_pass`` and a ``send`` that has to wait,
  deterministically;
* ``data_bitrate``: of FD frames; ``bit_error_rate``: disturbed bits; ``seed``;
* ``traffic``: a ``.dbc`` or ``.toml`` file whose periodic messages are on the bus as well;
* ``acknowledge=True``: a silent node acknowledges all frames. Without, a frame of a node that is
  alone on the bus is sent again and again, as on a real one.

Each node decides for itself:

* ``fd=True``: it sends and receives FD frames; without, it behaves like a classic SocketCAN socket;
* ``queue="priority"``: its frames are sent by priority; by default in the order of queueing;
* ``enobufs=True``: ``send`` fails at once when its queue is full, as on SocketCAN;
* ``receive_own_messages``, and ``preserve_timestamps``: its frames keep their time stamps.

Sending an error frame puts an error flag on the idle bus, which all nodes see and count.
"""

import errno
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from random import randint
from typing import Any, Final

import can
from can.typechecking import AutoDetectedConfig

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.can_bus.kernel.layout import BUS_OFF, ERROR_PASSIVE
from canroll.plant_sim.can_bus.kernel.network import (
    NetworkSpec,
    Node,
    Segment,
    build_network,
)
from canroll.plant_sim.can_bus.servers.frames import message_of, sent_flags, truth
from canroll.plant_sim.can_bus.servers.hub import Hub, HubError, HubPort, QueueFullError
from canroll.plant_sim.can_bus.simulation.response_times import traffic_spec
from canroll.plant_sim.can_bus.traffic.files import load_traffic

QUEUES: Final = ("fifo", "priority")
_LOGGER: Final = logging.getLogger("can.simbus")


class _Shared:
    """A hub and the settings it was opened with."""

    def __init__(self, hub: Hub, settings: dict[str, Any]) -> None:
        self.hub = hub
        self.settings = settings


_HUBS: Final[dict[str, _Shared]] = {}
_LOCK: Final = threading.Lock()


_SETTINGS: Final[dict[str, Callable[[Any], Any]]] = {
    "bitrate": int,
    "data_bitrate": int,
    "virtual_time": truth,
    "bit_error_rate": float,
    "traffic": str,
    "acknowledge": truth,
    "seed": int,
}
"""Options set by the first node on a channel, and their types."""


def _settings(given: dict[str, Any]) -> dict[str, Any]:
    settings = {}
    for key, understand in _SETTINGS.items():
        try:
            settings[key] = None if given[key] is None else understand(given[key])
        except (TypeError, ValueError) as error:
            raise can.CanInitializationError(f"simbus: {key}={given[key]!r}: a number") from error
    return settings


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
    bitrate = 500_000 if settings["bitrate"] is None else settings["bitrate"]
    data_bitrate, seed = settings["data_bitrate"], settings["seed"] or 0
    spec = NetworkSpec(segments=(Segment(bitrate, data_bitrate or 0),), nodes=(), seed=seed)
    if settings["traffic"] is not None:
        traffic = load_traffic(
            Path(settings["traffic"]), bitrate=bitrate, data_bitrate=data_bitrate
        )
        spec = traffic_spec(
            traffic.messages, bitrate=bitrate, data_bitrate=traffic.data_bitrate, seed=seed
        )
    errors = settings["bit_error_rate"] or 0.0
    segments = tuple(replace(s, bit_error_rate=errors) for s in spec.segments)
    silent = (Node("silent"),) if settings["acknowledge"] else ()
    spec = replace(spec, segments=segments, nodes=(*spec.nodes, *silent))
    hub = Hub(build_network(spec), virtual_time=bool(settings["virtual_time"]))
    _HUBS[channel] = _Shared(hub, settings)
    return hub


class SimBus(can.BusABC):
    """One node on a simulated bus; see the module for the options.

    Raises:
        can.CanInitializationError: the settings are invalid, or differ from those of the open
        channel.
    """

    def __init__(
        self,
        channel: Any = "simbus0",  # noqa: ANN401
        *,
        bitrate: int | str | None = None,
        data_bitrate: int | str | None = None,
        fd: bool | str = False,
        virtual_time: bool | str | None = None,
        receive_own_messages: bool | str = False,
        preserve_timestamps: bool | str = False,
        queue: str = "fifo",
        enobufs: bool | str = False,
        acknowledge: bool | str | None = None,
        bit_error_rate: float | str | None = None,
        traffic: str | Path | None = None,
        seed: int | str | None = None,
        can_filters: Any = None,  # noqa: ANN401
        **kwargs: Any,  # noqa: ANN401
    ) -> None:
        self._open = False
        settings = _settings(
            {
                "bitrate": bitrate,
                "data_bitrate": data_bitrate,
                "virtual_time": virtual_time,
                "bit_error_rate": bit_error_rate,
                "traffic": traffic,
                "acknowledge": acknowledge,
                "seed": seed,
            }
        )
        self.channel = channel
        self._fd = truth(fd)
        self._enobufs = truth(enobufs)
        self._preserve_timestamps = truth(preserve_timestamps)
        try:
            if queue not in QUEUES:
                raise UnknownNameError("queue", queue, QUEUES)
            with _LOCK:
                self.hub = _open_hub(str(channel), settings)
                self.port: HubPort = self.hub.open_port(
                    receive_own=truth(receive_own_messages), fd=self._fd, queue=queue
                )
        except CanrollError as error:
            raise can.CanInitializationError(f"simbus: {error}") from error
        self.channel_info = f"simbus {channel}, node {self.port.node}"
        self._can_protocol = can.CanProtocol.CAN_FD if self._fd else can.CanProtocol.CAN_20
        self._open = True
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue ``msg`` for arbitration, as soon as the transmit queue has room.

        Args:
            msg: the frame; an error frame puts an error flag on the bus.
            timeout: longest wait for room in seconds of bus time; 0: none; None: no limit, unless
                the bus was opened with ``enobufs``.

        Raises:
            can.CanOperationError: the bus is shut down, the node bus-off, its queue full for longer
                than ``timeout`` (``error_code`` ENOBUFS), the frame invalid or FD without ``fd``;
                in virtual time also if no node can acknowledge and make room.
        """
        if not self._open:
            raise can.CanOperationError("send on a bus that has been shut down")
        flags = sent_flags(msg, fd=self._fd, where=self.channel_info)
        try:
            self.hub.send(
                self.port,
                msg.arbitration_id,
                flags,
                msg.dlc,
                b"" if msg.is_remote_frame else bytes(msg.data),
                timeout_s=0.0 if self._enobufs else timeout,
                stamp_s=msg.timestamp if self._preserve_timestamps else None,
            )
        except QueueFullError as error:
            text = f"{self.channel_info}: {error}"
            raise can.CanOperationError(text, errno.ENOBUFS) from error
        except (HubError, ValueError) as error:
            raise can.CanOperationError(f"{self.channel_info}: {error}") from error
        finally:
            self._warn()

    def _warn(self) -> None:
        """Warn once per bus that no node acknowledges the frames of a lone node."""
        if self.hub.unacknowledged and not self.hub.warned:
            self.hub.warned = True
            _LOGGER.warning(
                "simbus %s: no acknowledgement, because the node is alone on the bus; it "
                "retransmits without end (acknowledge=True adds a silent node that acknowledges)",
                self.channel,
            )

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None after ``timeout`` seconds of bus time.

        In virtual time, returns None at once if no event is left on the bus.
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
        frame = self.hub.receive(self.port, timeout)
        if self.hub.unacknowledged:
            self._warn()
        if frame is None:
            return None, False
        return message_of(frame, self.channel, self.port.node), False

    def let_pass(self, duration_s: float) -> None:
        """Advance bus time: in virtual time at once, otherwise by sleeping."""
        self.hub.let_pass(duration_s)
        self._warn()

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
                _HUBS.pop(str(self.channel), None)
                self.hub.stop()

    @staticmethod
    def _detect_available_configs() -> Sequence[AutoDetectedConfig]:
        """Return the open channels and one unused channel."""
        with _LOCK:
            channels = list(_HUBS)
        unused = "simbus0"
        while unused in channels:
            unused = f"simbus{randint(1, 9999)}"
        return [{"interface": "simbus", "channel": channel} for channel in (*channels, unused)]
