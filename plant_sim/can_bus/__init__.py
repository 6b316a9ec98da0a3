"""CAN that behaves like CAN: segments, arbitration, queues, errors, gateways, traffic.

A network is built in Python and advanced by compiled kernels, from Python or from other kernels::

    network = make_network(load_profile("gateway_50ms"), seed=1)
    enqueue(network, IMU, t_ns, 0xA0, 8, payload)   # payload: uint8 array, copied
    advance(network, until_ns)                      # everything up to and including until_ns
    entries, cursor, missed = drain(network, cursor)

Conventions: times are int64 nanoseconds. A frame occupies the bus from SOF to the end of the
three-bit interframe space, where its response time ends (``t_end − t_queued``); receivers take it
at the end of the last-but-one EOF bit (``t_received``). A frame queued at the very instant of a
start of frame takes part in that arbitration. Every queued frame appears in the log exactly once
with its final outcome: delivered, superseded, or lost with the reason (``OUTCOMES``). Entries with
outcome ``ERROR`` are failed attempts of a frame that is still pending; with ``REFUSED``, attempts
that every receiver except ``missed`` accepted. ``account`` checks that the counts add up.

In a kernel, entry number k of ``logged(network)`` is ``network.log[k % len(network.log)]``. A node
receives the entries of its own ``segment`` for which ``took`` is true, except those it sent and
those that came while it did not hear (``hears``: down or bus-off). A gateway forwards frames from
its node on the other segment; ``t_origin`` remains the time at which the original sender queued
the frame.

Beside the kernels: ``traffic`` (message sets, background, recorded logs), ``network`` (segments,
routes, own frames), ``bounds`` (worst-case response times and delays, over gateways),
``simulation`` (simulated response times and ages), and for other programs ``servers`` (python-can
interfaces, socketcand).
"""

from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.buses.topology import NODES
from canroll.plant_sim.can_bus.kernel.layout import (
    DELIVERED,
    ERROR,
    LOG_SIZE,
    LOGGED,
    NOW,
    OUTCOMES,
    REFUSED,
    SUPERSEDED,
    Network,
    State,
    logged,
)
from canroll.plant_sim.can_bus.kernel.ledger import Account, account, drain, load, took
from canroll.plant_sim.can_bus.kernel.log import log_dtype
from canroll.plant_sim.can_bus.kernel.network import (
    BusFault,
    Gateway,
    NetworkSpec,
    Node,
    Segment,
    Source,
    add_fault,
    add_node,
    add_source,
    build_network,
)
from canroll.plant_sim.can_bus.kernel.queues import enqueue, hears, submit
from canroll.plant_sim.can_bus.kernel.scheduler import advance, run
from canroll.plant_sim.can_bus.network.network_file import load_profile
from canroll.plant_sim.can_bus.network.profiles import (
    ACTUATOR,
    CHASSIS,
    ECU,
    IMU,
    REFERENCE,
    SUSPENSION,
    make_network,
    profile_spec,
    recorded_traffic,
)

__all__ = [
    "ACTUATOR",
    "CHASSIS",
    "DELIVERED",
    "ECU",
    "ERROR",
    "IMU",
    "LOGGED",
    "LOG_SIZE",
    "NODES",
    "NOW",
    "OUTCOMES",
    "REFERENCE",
    "REFUSED",
    "SUPERSEDED",
    "SUSPENSION",
    "Account",
    "BusFault",
    "BusProfile",
    "Gateway",
    "Network",
    "NetworkSpec",
    "Node",
    "Segment",
    "Source",
    "State",
    "account",
    "add_fault",
    "add_node",
    "add_source",
    "advance",
    "build_network",
    "drain",
    "enqueue",
    "hears",
    "load",
    "load_profile",
    "log_dtype",
    "logged",
    "make_network",
    "profile_spec",
    "recorded_traffic",
    "run",
    "submit",
    "took",
]
