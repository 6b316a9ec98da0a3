"""How long something lasts, and by how much it exceeds: what the monitors count by."""

from firmware.calibration import STATE_MAX
from firmware.subset import clamp, i32


def magnitude(value: i32) -> i32:
    """Return the magnitude of ``value``, at most ``STATE_MAX``."""
    return clamp(value, clamp(-value, 0, STATE_MAX), STATE_MAX)


def lasting(count: i32, bad: i32, samples: i32) -> i32:
    """Return the number of ``bad`` samples in a row, at most ``samples``; a bad one may be two."""
    if bad == 0:
        return 0
    return clamp(count + bad, 0, samples)


def beyond(value: i32, limit: i32) -> i32:
    """Return 1 for a value beyond ``limit``, 2 beyond its double, which needs half the time."""
    if value > limit + limit:
        return 2
    if value > limit:
        return 1
    return 0


def side_of(one: i32, other: i32, least: i32) -> i32:
    """Return 1 where both exceed ``least``, -1 where both are below its negative, else 0."""
    if one > least and other > least:
        return 1
    if one < -least and other < -least:
        return -1
    return 0
