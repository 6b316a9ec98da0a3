"""What the ECU receives in a run."""

from canroll.codegen.run.backends import Recorder, open_backend
from canroll.codegen.run.ecu_traffic import EcuTraffic
from canroll.runs.experiment import build_world
from canroll.runs.result import Run
from canroll.runs.virtual_time import closed_loop
from canroll.setup.controller import Controller


def record_traffic(settings: Run, controller: Controller, duration: float) -> EcuTraffic:
    """Drive the first ``duration`` seconds with control; return what the ECU received."""
    firmware = settings.firmware
    ecu = open_backend(settings.backend, controller.record, firmware, key=settings.secret)
    recorder = Recorder(ecu, firmware)
    closed_loop(
        build_world(settings, enabled=True),
        recorder,
        tick_ns=round(settings.tick * 1e9),
        duration_ns=round(duration * 1e9),
        progress=None,
    )
    return recorder.traffic
