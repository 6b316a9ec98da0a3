"""Where an engineer's own stage runs in the loop; this one does nothing and costs nothing.

``codegen.run.own_stage`` puts a module with some of these functions in its place. Calls of a
function that does nothing are left out when the loop is translated, so without an own stage the C
has none of them. A stage stores in its own fields and in ``ecu.x`` only; schedule, moment limit,
slew limit and allocation come after it.
"""

from firmware.calibration import Calibration
from firmware.state import Ecu
from firmware.subset import i32


def start(ecu: Ecu, cal: Calibration) -> None:
    """Start; all fields are zero. Runs once, at the end of ``init``."""


def estimate(ecu: Ecu, cal: Calibration, steps: i32) -> None:
    """Correct the estimate ``ecu.x``, which the observer has just made over ``steps`` ticks."""


def moment(ecu: Ecu, cal: Calibration, wanted: i32, output: i32, steps: i32) -> i32:
    """Return the moment to give (Q14) where the law wants ``wanted``, in ACTIVE and DEGRADED.

    ``output`` is 0; a law that commands both axles has a second call a tick, with 1 for the rear.
    """
    return wanted


def rest(ecu: Ecu, cal: Calibration) -> None:
    """Rest for a tick in which no law runs, in INIT and SAFE."""
