"""Hooks for an engineer's own stage; the default ones are empty and cost nothing.

``canroll.codegen.generated.own_stage`` replaces this module by one with some of these functions.
Calls of empty functions are omitted when the loop is translated, so without an own stage the C has
none of them. A stage writes only its own fields and ``ecu.x``; schedule, moment limit, slew limit
and allocation follow it.
"""

from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import i32


def start(ecu: Ecu, cal: Calibration) -> None:
    """Start; all fields are zero. Runs once, at the end of ``init``."""


def estimate(ecu: Ecu, cal: Calibration, steps: i32) -> None:
    """Correct the estimate ``ecu.x``, just updated by the observer over ``steps`` ticks."""


def moment(ecu: Ecu, cal: Calibration, wanted: i32, output: i32, steps: i32) -> i32:
    """Return the moment to apply (Q14) instead of the law's ``wanted``, in ACTIVE and DEGRADED.

    ``output`` is 0; for a law that commands both axles there is a second call per tick, with 1 for
    the rear.
    """
    return wanted


def rest(ecu: Ecu, cal: Calibration) -> None:
    """Called instead of :func:`moment` in a tick without a law, in INIT and SAFE."""
