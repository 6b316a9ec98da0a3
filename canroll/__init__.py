"""From a roll-stability control law to verified code on a CAN ECU.

The public interface in one place; heavy modules are imported on first use:

* :func:`run` drives a manoeuvre without and with control and returns a :class:`Result`: its
  :class:`Run` as planned, a :class:`Trace` of each, and the figures,
* :func:`load_vehicle` reads a preset or a vehicle file as a :class:`Vehicle`,
* :func:`load_calibration` reads what ``canroll design`` wrote,
* :func:`design` finds and verifies a control law,
* :func:`margins` verifies a calibration again,
* :func:`plot` draws a run,
* :func:`drive` steps a car and its ECU, for code of your own in the loop,
* :func:`compare`, :func:`campaign` and :func:`severe` drive many runs,
* :func:`understeer`, :func:`response` and :func:`limit` test a vehicle,
* :func:`fit` finds its numbers from a measured drive, :func:`validate` judges them by another,
* :func:`bus` computes response times and delays of a network, traffic set or log.

Each result has a verdict or figures as its ``repr``, and a ``table`` (:class:`Table`).
"""

from typing import TYPE_CHECKING, Any

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.cases.execution import Execution
    from canroll.gain_gen.calibration.calibration_file import load as load_calibration
    from canroll.gain_gen.design import design
    from canroll.gain_gen.margin_report import margin_report as margins
    from canroll.gain_gen.models.task import Delay, Design, Task
    from canroll.handling.vehicle_tests import limit, response, understeer
    from canroll.network.responses import bus
    from canroll.report.picture import plot
    from canroll.runs.experiment import run
    from canroll.runs.result import Result, Run
    from canroll.runs.trace import Trace
    from canroll.setup.controller import Controller
    from canroll.stepping import drive
    from canroll.studies.comparison import compare
    from canroll.studies.severe import study as severe
    from canroll.table import Table
    from canroll.vehicles import Vehicle
    from canroll.vehicles import load as load_vehicle

__all__ = [
    "CanrollError",
    "Controller",
    "Delay",
    "Design",
    "Execution",
    "Result",
    "Run",
    "Table",
    "Task",
    "Trace",
    "UnknownNameError",
    "Vehicle",
    "VerdictError",
    "bus",
    "compare",
    "design",
    "drive",
    "limit",
    "load_calibration",
    "load_vehicle",
    "margins",
    "plot",
    "response",
    "run",
    "severe",
    "understeer",
]

_NAMES: "Registry[Any]" = Registry(
    "name",
    "canroll.names",
    {
        "Controller": "canroll.setup.controller:Controller",
        "Delay": "canroll.gain_gen.models.task:Delay",
        "Design": "canroll.gain_gen.models.task:Design",
        "Execution": "canroll.cases.execution:Execution",
        "Result": "canroll.runs.result:Result",
        "Run": "canroll.runs.result:Run",
        "Table": "canroll.table:Table",
        "Task": "canroll.gain_gen.models.task:Task",
        "Trace": "canroll.runs.trace:Trace",
        "Vehicle": "canroll.vehicles:Vehicle",
        "bus": "canroll.network.responses:bus",
        "compare": "canroll.studies.comparison:compare",
        "design": "canroll.gain_gen.design:design",
        "drive": "canroll.stepping:drive",
        "limit": "canroll.handling.vehicle_tests:limit",
        "load_calibration": "canroll.gain_gen.calibration.calibration_file:load",
        "load_vehicle": "canroll.vehicles:load",
        "margins": "canroll.gain_gen.margin_report:margin_report",
        "plot": "canroll.report.picture:plot",
        "response": "canroll.handling.vehicle_tests:response",
        "run": "canroll.runs.experiment:run",
        "severe": "canroll.studies.severe:study",
        "understeer": "canroll.handling.vehicle_tests:understeer",
    },
)


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import a name of the public interface on first use; extensions add to them."""
    if name not in list(_NAMES):
        raise AttributeError(f"module 'canroll' has no attribute '{name}'")
    try:
        return _NAMES[name]
    except CanrollError as error:  # of a package; what looks for names goes on
        raise AttributeError(str(error)) from error


def __dir__() -> list[str]:
    """Show the public names alone, also those that are not imported yet."""
    return sorted({*__all__, *_NAMES})
