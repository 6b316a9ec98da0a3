"""Units of the recorded signals."""

_UNITS = {
    "x": "m",
    "y": "m",
    "yaw": "rad",
    "vx": "m/s",
    "vy": "m/s",
    "ax": "m/s²",
    "ay": "m/s²",
    "roll": "rad",
    "pitch": "rad",
    "heave": "m",
    "path_error": "m",
    "steer": "rad",
    "bank": "rad",
}
_FAMILIES = {
    "wheel_load": "N",
    "travel_rate": "m/s",
    "travel": "m",
    "wheel_speed": "rad/s",
    "wheel_height": "m",
    "lateral_force": "N",
    "corner_force": "N",
    "bar_angle": "rad",
    "bar_pressure": "Pa",
    "bar_moment": "N·m",
    "moment": "N·m",
    "valve_current": "A",
}
_RATES = {"yaw": "rad", "roll": "rad", "pitch": "rad", "heave": "m"}


def unit(name: str) -> str:
    """Return the unit of a recorded signal, '' for flags and units that depend on the actuator."""
    if name in _UNITS:
        return _UNITS[name]
    stem, _, derivative = name.rpartition("_")
    if stem in _RATES and derivative in ("rate", "acc"):
        return _RATES[stem] + ("/s" if derivative == "rate" else "/s²")
    return next((u for family, u in _FAMILIES.items() if name.startswith(family)), "")
