"""Allocation of the moment over the actuators.

Four corners: F_fl = -F_fr = u s / (2 t_f), F_rl = -F_rr = u (1 - s) / (2 t_r), with s the front
share and t the half track (Redondo 2021, force split with s = l_r / l), so that the sum of y F
is u. Any excess over a limit is taken by the axle's other corner, then by the other axle, within
the share that keeps the car's steering balance. Dampers follow the four-condition rule of Yim 2020,
(25) to (28).
"""

from canroll.firmware.calibration import BARS, DAMPERS, ONE, STATE_MAX, SUSPENSION, Calibration
from canroll.firmware.fixed_point import magnitude, product, quotient
from canroll.firmware.state import Ecu
from canroll.firmware.subset import clamp, i32, narrow, rsh, sat31, sat32

LEFT = 0
RIGHT = 1
FRONT = 0
REAR = 1
SOFT = 0
FIRM = 1
# more than any corner gives, and little enough that two of it fit 32 bits
FORCE_MAX = 1 << 29
SIDE_SIGN: tuple[i32, ...] = (1, -1, 1, -1)


def entrusted(limit: i32, wanted: i32, trust: i32) -> i32:
    """Return the limit of an actuator, or of one that has failed a share of what is wanted."""
    if trust == ONE:
        return limit
    return product(clamp(magnitude(wanted), 0, limit), trust, 30)


def split_axle(ecu: Ecu, cal: Calibration, axle: i32, moment: i32) -> i32:
    """Split an axle's moment over its corners; return the part beyond their limits."""
    arm: i32 = cal.arm_front
    track: i32 = cal.track_front
    if axle == REAR:
        arm = cal.arm_rear
        track = cal.track_rear
    left: i32 = 2 * axle
    want: i32 = clamp(rsh(moment * arm, 28), -FORCE_MAX, FORCE_MAX)
    limit_left: i32 = entrusted(cal.force_max[left], want, ecu.trust[left])
    limit_right: i32 = entrusted(cal.force_max[left + 1], want, ecu.trust[left + 1])
    up: i32 = clamp(want, -limit_left, limit_left)
    down: i32 = clamp(2 * want - up, -limit_right, limit_right)
    lack: i32 = 2 * want - up - down
    if lack != 0:
        up = clamp(up + lack, -limit_left, limit_left)
        lack = 2 * want - up - down
    ecu.force[left] = up
    ecu.force[left + 1] = -down
    if lack == 0:
        return 0
    return product(lack, track, 29)


def front_moment(ecu: Ecu, moment: i32) -> i32:
    """Return the scheduled front part of a moment."""
    return narrow(rsh(moment * ecu.front_share, 30))


def slack(cal: Calibration, moment: i32) -> i32:
    """Return the part of a moment that may move from one axle to the other."""
    size: i32 = moment
    if size < 0:
        size = -size
    return narrow(rsh(size * cal.share_slack, 30))


def allocate_suspension(ecu: Ecu, cal: Calibration, moment: i32) -> None:
    """Four corner forces for a moment: each axle takes the other's excess, within the slack."""
    front: i32 = front_moment(ecu, moment)
    rear: i32 = sat31(moment - front)
    lack: i32 = split_axle(ecu, cal, FRONT, front)
    moved: i32 = 0
    if lack != 0:
        room: i32 = slack(cal, moment)
        moved = clamp(lack, -room, room)
        rear = sat31(rear + moved)
    lack_rear: i32 = split_axle(ecu, cal, REAR, rear)
    if lack_rear != 0:
        back: i32 = slack(cal, moment)
        back = clamp(lack_rear - moved, -back, back)
        front = sat31(front + back)
        lack = split_axle(ecu, cal, FRONT, front)
        rear = sat31(rear - lack_rear)
    ecu.given = sat31(front - lack + rear)


def bar_limit(ecu: Ecu, cal: Calibration, axle: i32, wanted: i32) -> i32:
    """Return the largest moment of a bar, in the end none where one of its corners has failed."""
    trust: i32 = clamp(ecu.trust[2 * axle], 0, ecu.trust[2 * axle + 1])
    return entrusted(cal.bar_max[axle], wanted, trust)


def allocate_bars(ecu: Ecu, cal: Calibration, moment: i32) -> None:
    """Front and rear bar moments: of a law with one output by share, of one with two its own."""
    front: i32 = front_moment(ecu, moment)
    rear: i32 = sat31(moment - front)
    if cal.compensator_outputs == 2:
        front = ecu.outputs[0]
        rear = ecu.outputs[1]
    room: i32 = slack(cal, moment)
    limit_front: i32 = bar_limit(ecu, cal, FRONT, front)
    limit_rear: i32 = bar_limit(ecu, cal, REAR, rear)
    lack_front: i32 = front - clamp(front, -limit_front, limit_front)
    lack_rear: i32 = rear - clamp(rear, -limit_rear, limit_rear)
    front = sat32(front + clamp(lack_rear, -room, room))
    rear = sat32(rear + clamp(lack_front, -room, room))
    ecu.bar[FRONT] = clamp(front, -limit_front, limit_front)
    ecu.bar[REAR] = clamp(rear, -limit_rear, limit_rear)
    ecu.given = ecu.bar[FRONT] + ecu.bar[REAR]


def damper_force(cal: Calibration, speed: i32, setting: i32) -> i32:
    """Return the force of the SOFT or FIRM setting at a stroke speed >= 0 (Q27), as Q14."""
    knee: i32 = cal.damper_speed[setting]
    force: i32 = cal.damper_force[setting]
    if speed < knee:
        return clamp(quotient(force * speed, knee), 0, STATE_MAX)
    beyond: i32 = product(cal.damper_slope[setting], speed - knee, 27)
    return clamp(force + beyond, 0, STATE_MAX)


def allocate_dampers(ecu: Ecu, cal: Calibration, moment: i32) -> None:
    """Damper currents: firm as far as a damper's force has the wanted direction, else soft."""
    front: i32 = front_moment(ecu, moment)
    rear: i32 = sat31(moment - front)
    for corner in range(4):
        force: i32 = product(front, cal.arm_front, 28)
        if corner >= 2:
            force = product(rear, cal.arm_rear, 28)
        if ecu.failed[corner ^ 1] == 1:
            # its other side does nothing, or nothing that is asked
            force = sat31(2 * force)
        speed: i32 = ecu.stroke_rate[corner]
        # an extending damper pulls the body down
        force = -force * SIDE_SIGN[corner]
        if speed < 0:
            speed = -speed
            force = -force
        soft: i32 = damper_force(cal, speed, SOFT)
        firm: i32 = damper_force(cal, speed, FIRM)
        span: i32 = clamp(firm - soft, 1, STATE_MAX)
        share: i32 = clamp(quotient((force - soft) * (1 << 28), span), 0, 1 << 28)
        ecu.current[corner] = clamp(product(share, cal.current_max, 28), 0, cal.current_max)


def allocate(ecu: Ecu, cal: Calibration) -> None:
    """Turn the outputs of the law into the quantities of their frame."""
    if cal.actuator == SUSPENSION:
        allocate_suspension(ecu, cal, ecu.moment)
    elif cal.actuator == BARS:
        allocate_bars(ecu, cal, ecu.moment)
    elif cal.actuator == DAMPERS:
        allocate_dampers(ecu, cal, ecu.moment)
    else:
        for axle in range(2):
            ecu.current[axle] = clamp(ecu.outputs[axle], -cal.current_max, cal.current_max)
            if (ecu.failed[2 * axle] | ecu.failed[2 * axle + 1]) == 1:
                ecu.current[axle] = 0
