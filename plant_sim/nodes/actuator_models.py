"""A 1 ms step of each of the four kinds of roll actuators.

Forces act on the body, upwards, with their reaction on the wheel; moments lift the left side.
Force over a step is the mean of its values at both ends, so that a lag costs no half step.
"""

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.schedule import factor, most, total
from canroll.plant_sim.nodes import actuator_kernel as kernel
from canroll.plant_sim.nodes import hydraulics
from canroll.plant_sim.nodes.actuator_kernel import ActuatorNode, follows, set_status
from canroll.typing import Vector

TORQUE_LOOP = 40.0
"""Bandwidth (rad/s) of the valves' loop."""
# Share of its way that a channel without lag goes in a step, for one that is to be slowed down.
SLOWED = 0.99

AXLE = 0b11
"""Corners of the front axle, bit by bit."""

# Second message of the nodes that take two, besides currents.
FORCES = MOMENTS = 1


@njit
def clip(value: float, limit: float) -> float:
    """``value`` within ± ``limit``."""
    return min(max(value, -limit), limit)


@njit
def refer(node: ActuatorNode, channel: int, demand: float) -> bool:
    """Move a channel's reference towards ``demand``; return whether limit or rate was active."""
    kept = clip(demand, node.limit)
    change = node.rate
    if not node.held:
        change = min(change, node.fading[channel])
    step = kept - node.reference[channel]
    hold(node, channel, node.reference[channel] + clip(step, change))
    return bool(kept != demand or abs(step) > change)


@njit
def hold(node: ActuatorNode, channel: int, reference: float) -> None:
    """Set a channel's reference, and while a command is held how fast it fades after it."""
    node.reference[channel] = reference
    if node.held:
        node.fading[channel] = abs(reference) * node.fade


@njit
def settle(  # noqa: PLR0917
    node: ActuatorNode, channel: int, corners: int, target: float, bound: bool, t_ns: int
) -> None:
    """Follow ``target`` with the lag, unless a fault of ``corners`` (bit by bit) acts.

    Of several faults the worst decides: stuck, no force, uncommanded force.
    """
    lag = node.lag
    status = kernel.STATUS_LIMITED if bound else kernel.STATUS_OK
    if node.fault[0].places:
        limit = node.limit
        derated = factor(node.fault, kernel.DERATING, corners, t_ns)
        if abs(target) > derated * limit:
            target, status = clip(target, derated * limit), kernel.STATUS_LIMITED
        share = factor(node.fault, kernel.WEAK, corners, t_ns)
        if share != 1.0:
            target, status = share * target, kernel.STATUS_LIMITED
        target *= 1.0 - 2.0 * most(node.fault, kernel.REVERSED, corners, t_ns)
        target = clip(target + limit * total(node.fault, kernel.RUNAWAY, corners, t_ns), limit)
        target *= 1.0 - most(node.fault, kernel.DEAD, corners, t_ns)
        floating = most(node.fault, kernel.FLOATING, corners, t_ns)
        if floating > 0.0:
            target, status = (1.0 - floating) * target, kernel.STATUS_FLOATING
        if most(node.fault, kernel.STUCK, corners, t_ns) > 0.0:
            target, status = node.actual[channel], kernel.STATUS_STUCK
        slow = factor(node.fault, kernel.SLOW, corners, t_ns)
        if slow != 1.0:
            lag = 1.0 - (1.0 - min(lag, SLOWED)) ** (1.0 / slow)
    if not node.powered:
        target, status = 0.0, kernel.STATUS_FLOATING
    before = node.actual[channel]
    node.actual[channel] += lag * (target - before)
    node.applied[channel] = 0.5 * (before + node.actual[channel])
    show(node, corners, status, t_ns)


@njit
def show(node: ActuatorNode, corners: int, status: int, t_ns: int) -> None:
    """Set the status of ``corners``, unless they lie about it."""
    if node.fault[0].places and most(node.fault, kernel.LYING, corners, t_ns) > 0.0:
        status = kernel.STATUS_OK
    set_status(node, corners, status)


@njit
def _suspension(node: ActuatorNode, outputs: Vector, inputs: Vector, t_ns: int) -> None:
    for corner in range(4):
        demand = node.demand[corner] if follows(node) else 0.0
        bound = refer(node, corner, demand)
        target = node.reference[corner]
        stroke = outputs[ports.TRAVEL_RATE + corner]
        if target * stroke > node.power:
            target = node.power / stroke
            bound = True
        settle(node, corner, 1 << corner, target, bound, t_ns)
        inputs[ports.CORNER_FORCE + corner] = node.applied[corner]


@njit
def _bars(node: ActuatorNode, inputs: Vector, t_ns: int) -> None:
    for axle in range(2):
        demand = node.demand[axle] if follows(node) else 0.0
        bound = refer(node, axle, demand)
        # A bar joins both corners of its axle: the worse of their faults decides.
        settle(node, axle, AXLE << 2 * axle, node.reference[axle], bound, t_ns)
        inputs[ports.BAR_MOMENT_FRONT + axle] = node.applied[axle]


@njit
def span(curve: Vector, rate: float) -> float:
    """Force (N) between softest and firmest setting at stroke rate ``rate`` >= 0 (m/s).

    ``curve`` (3, n): rates, soft and firm forces; the last slope goes on beyond the last rate.
    """
    last = curve.shape[1] - 1
    k = 1
    while k < last and rate > curve[0, k]:
        k += 1
    share = (rate - curve[0, k - 1]) / (curve[0, k] - curve[0, k - 1])
    low = curve[2, k - 1] - curve[1, k - 1]
    high = curve[2, k] - curve[1, k]
    return float(max(low + share * (high - low), 0.0))


@njit
def semi_active_setting(curve: Vector, force: float, stroke_rate: float) -> float:
    """Damper setting (0 soft to 1 firm) for ``force`` (N) on the body on top of the soft one.

    The four conditions of Yim 2020 (25) to (28), one corner at a time: a damper only opposes its
    stroke, so a force along the stroke gets the softest setting.
    """
    if force * stroke_rate >= 0.0:
        return 0.0
    room = span(curve, abs(stroke_rate))
    if abs(force) >= room:
        return 1.0
    return abs(force) / room


@njit
def _dampers(node: ActuatorNode, outputs: Vector, inputs: Vector, t_ns: int) -> None:
    for corner in range(4):
        stroke = outputs[ports.TRAVEL_RATE + corner]
        demand = node.demand[corner] if follows(node) else 0.0
        if node.source == FORCES:
            wanted = semi_active_setting(node.curve, demand, stroke)
        else:
            wanted = demand * 1e-3 / node.current_limit
        bound = refer(node, corner, max(wanted, 0.0))
        settle(node, corner, 1 << corner, node.reference[corner], bound, t_ns)
        force = node.applied[corner] * span(node.curve, abs(stroke))
        inputs[ports.CORNER_FORCE + corner] = -force if stroke > 0.0 else force


@njit
def _valve_current(node: ActuatorNode, axle: int, actual: float, t_ns: int) -> float:
    """Current (A) commanded for the axle; a disabled node controls the moment to zero."""
    parameters, loop = node.hydraulics, TORQUE_LOOP
    demand = node.demand[axle]
    if node.fault[0].places:
        loop /= factor(node.fault, kernel.SLOW, AXLE << 2 * axle, t_ns)
        demand *= 1.0 - 2.0 * most(node.fault, kernel.REVERSED, AXLE << 2 * axle, t_ns)
    if not follows(node):
        return hydraulics.torque_loop(parameters, loop, 0.0, actual)
    if not node.held:
        refer(node, axle, 0.0)
        return hydraulics.torque_loop(parameters, loop, node.reference[axle], actual)
    hold(node, axle, actual)
    if node.source == MOMENTS:
        return hydraulics.torque_loop(parameters, loop, demand, actual)
    return float(demand * 1e-3)


@njit
def _valve_axle(node: ActuatorNode, axle: int, outputs: Vector, inputs: Vector, t_ns: int) -> int:
    """Advance one electro-hydraulic bar by a step; return its status."""
    parameters, motor = node.hydraulics, node.motor[axle]
    angle = outputs[ports.BAR_ANGLE + axle] if node.integrated else motor[hydraulics.ANGLE]
    before = hydraulics.active_moment(parameters, angle)
    corners = AXLE << 2 * axle
    wanted = _valve_current(node, axle, before, t_ns)
    limit = node.current_limit
    current = clip(wanted, limit)
    status = kernel.STATUS_OK if current == wanted else kernel.STATUS_LIMITED
    locked = not node.powered
    if node.fault[0].places:
        derated = limit * factor(node.fault, kernel.DERATING, corners, t_ns)
        if abs(current) > derated:
            current, status = clip(current, derated), kernel.STATUS_LIMITED
        share = factor(node.fault, kernel.WEAK, corners, t_ns)
        if share != 1.0:
            current, status = share * current, kernel.STATUS_LIMITED
        runaway = total(node.fault, kernel.RUNAWAY, corners, t_ns)
        current = clip(current + limit * runaway, limit)
        locked = locked or most(node.fault, kernel.DEAD, corners, t_ns) > 0.0
        if most(node.fault, kernel.STUCK, corners, t_ns) > 0.0:
            current, status = 0.0, kernel.STATUS_STUCK
        if most(node.fault, kernel.FLOATING, corners, t_ns) > 0.0:
            locked, status = True, kernel.STATUS_FLOATING
    if not node.powered:
        status = kernel.STATUS_FLOATING
    if locked:
        current = 0.0
    if node.integrated:
        inputs[ports.VALVE_CURRENT_FRONT + axle] = current
        node.applied[axle] = before
        return status
    if locked or not node.enabled:
        # The fail-safe valve holds the shaft in the middle: a plain bar.
        motor[:] = 0.0
    else:
        left = 2 * axle
        span = 2.0 * node.half_track[axle]
        roll = (outputs[ports.TRAVEL + left] - outputs[ports.TRAVEL + left + 1]) / span
        rate = (outputs[ports.TRAVEL_RATE + left] - outputs[ports.TRAVEL_RATE + left + 1]) / span
        if hydraulics.advance(motor, parameters, current, roll, rate):
            status = max(status, kernel.STATUS_LIMITED)
    after = hydraulics.active_moment(parameters, motor[hydraulics.ANGLE])
    node.applied[axle] = 0.5 * (before + after)
    inputs[ports.BAR_MOMENT_FRONT + axle] = node.applied[axle]
    return status


@njit
def _valves(node: ActuatorNode, outputs: Vector, inputs: Vector, t_ns: int) -> None:
    for axle in range(2):
        status = _valve_axle(node, axle, outputs, inputs, t_ns)
        show(node, AXLE << 2 * axle, status, t_ns)


@njit
def _commanded(node: ActuatorNode, axle: int) -> float:
    """Moment of an axle (N·m) that its command asks for, within the limit; currents: unknown."""
    if node.kind == kernel.SUSPENSION:
        left = clip(node.demand[2 * axle], node.limit)
        right = clip(node.demand[2 * axle + 1], node.limit)
        return float(node.half_track[axle] * (left - right))
    if node.kind == kernel.BARS:
        return clip(node.demand[axle], node.limit)
    return float(node.estimate[axle])


@njit
def act(node: ActuatorNode, outputs: Vector, inputs: Vector, t_ns: int) -> None:
    """Fill the actuator slots of ``inputs`` for the step that begins at ``t_ns``."""
    kind = node.kind
    if kind == kernel.SUSPENSION:
        _suspension(node, outputs, inputs, t_ns)
    elif kind == kernel.BARS:
        _bars(node, inputs, t_ns)
    elif kind == kernel.DAMPERS:
        _dampers(node, outputs, inputs, t_ns)
    else:
        _valves(node, outputs, inputs, t_ns)
    for axle in range(2):
        if kind in (kernel.SUSPENSION, kernel.DAMPERS):
            left = ports.CORNER_FORCE + 2 * axle
            total = node.half_track[axle] * (inputs[left] - inputs[left + 1])
        else:
            total = node.applied[axle]
        node.delivered[axle] = total
        error = node.estimate_gain * total - node.estimate[axle]
        node.estimate[axle] += node.estimate_lag * error
        if node.fault[0].places and node.held:
            lying = most(node.fault, kernel.LYING, AXLE << 2 * axle, t_ns)
            if lying > 0.0:
                node.estimate[axle] = _commanded(node, axle)
