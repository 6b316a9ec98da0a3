"""What a calibration has beyond its law."""

from dataclasses import dataclass

from canroll.gain_gen.monitors.uncertainty import DEFAULT, Uncertainty
from canroll.vehicles.actuators import ACTUATORS

ACTUATOR_NUMBER = {name: actuator.number for name, actuator in ACTUATORS.items()}


@dataclass(frozen=True, slots=True)
class QuantiseOptions:
    """Options of a calibration beyond the law.

    Attributes:
        event_trigger: send commands by the event trigger instead of every tick.
        heartbeat: maximum time between commands, s.
        identification: identify roll stiffness and damping at run time.
        offset_learning: learn sensor offsets in straight running.
        response_watch: judge reported moments by the body's roll, which needs SuspensionRate.
        sample_period: time in which the inertial unit counts one sample, 0: it is not judged, s.
        moment_reported: the actuators report the delivered moment; otherwise the commanded one
            counts as delivered.
        uncertainty: what is not known of car, sensors and road.
    """

    event_trigger: bool = True
    heartbeat: float = 0.05
    identification: bool = False
    offset_learning: bool = False
    response_watch: bool = False
    sample_period: float = 0.0
    moment_reported: bool = True
    uncertainty: Uncertainty = DEFAULT
