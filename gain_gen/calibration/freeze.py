"""Contents of a calibration file besides its integers: design, margins, verdicts, sources."""

from dataclasses import asdict, replace
from importlib.metadata import version

import numpy as np

from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import check
from canroll.gain_gen.calibration.calibration_file import VEHICLE
from canroll.gain_gen.calibration.options import QuantiseOptions
from canroll.gain_gen.calibration.quantise import Quantised, law_kind, quantise_design
from canroll.gain_gen.calibration.record import fill, identify
from canroll.gain_gen.calibration.resolution import of_contract
from canroll.gain_gen.calibration.response_part import unwatched
from canroll.gain_gen.calibration.rounding_error import quantisation_checks
from canroll.gain_gen.calibration.summary import Tables, plain
from canroll.gain_gen.calibration.vehicle_part import share_of
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.models.task import Design


def calibrate(design: Design, options: QuantiseOptions | None = None) -> tuple[Calibration, Tables]:
    """Return the ECU's record of ``design`` and the tables that go with it.

    Raises:
        CanrollError: a value outside its field's range, or a law that the ECU cannot run.
    """
    options = options or QuantiseOptions()
    beyond = unwatched(design.task.vehicle) if options.response_watch else ""
    if beyond:
        options = replace(options, response_watch=False)
        note = f"delivered moments are not checked against the body's roll: {beyond}"
        design = replace(design, warnings=(*design.warnings, note))
    quantised = quantise_design(design, options)
    record = identify(fill(quantised.fields))
    refused = check(record)
    if refused:
        raise CanrollError(f"the calibration violates rule {refused} of the ECU's check")
    # where nothing is verified, as without control, this would be all
    checks = quantisation_checks(design, record) if design.verified else {}
    for name, result in checks.items():
        if not result.ok and not np.isinf(result.value):
            raise CanrollError(
                f"{design.law} for {design.task.vehicle.name}: {name} is {result.value:.3g}, more "
                f"than {result.limit:g}: its coefficients exceed the fixed-point formats"
            )
    verified = replace(design, verified={**design.verified, **checks})
    return record, design_tables(verified, quantised) | {"uncertainty": asdict(options.uncertainty)}


def design_tables(design: Design, quantised: Quantised) -> Tables:
    """Return the tables of a calibration file other than the integers."""
    task = design.task
    model = task.vehicle.design
    controller = design.controller
    gains: Tables = {"kind": law_kind(design)}
    if controller.output_gain is not None:
        gains["output_gain"] = plain(controller.output_gain)
    elif controller.compensator is not None:
        gains |= {name: plain(getattr(controller.compensator, name)) for name in "abecd"}
    else:
        gains |= {
            "feedback": plain(controller.feedback),
            "feedforward": plain(controller.feedforward),
        }
    gains["correction"] = plain(controller.observer.correction)
    return {
        "design": {
            "law": design.law,
            "vehicle": task.vehicle.reference,
            "actuator": task.actuator,
            "observer": task.observer,
            "gains": task.gains,
            "feedforward": task.feedforward,
            "front_share": round(share_of(task), 9),
            "verified": design.is_verified,
            "failed": design.failed,
            "tick_s": task.tick,
            "delay_s": task.delay.nominal,
            "delay_min_s": task.delay.least,
            "delay_max_s": task.delay.most,
            "resolution": asdict(task.resolution or of_contract()),
            "solve_s": design.solution.solve_seconds,
            "warnings": list(design.warnings),
        },
        "plant": {
            "roll_inertia": model.roll_inertia,
            "roll_damping": model.roll_damping,
            "roll_stiffness": model.roll_stiffness,
            "sprung_mass": model.sprung_mass,
            "cg_height_above_roll_axis": model.cg_height_above_roll_axis,
            "actuator_lag_s": task.lag,
        },
        "gains": gains,
        "margins": {**design.margins, "max_delay_s": design.max_delay, **_levels(design)},
        "verification": {name: check._asdict() for name, check in design.verified.items()},
        "formats": {
            name.replace("[", "_").replace("]", ""): {
                "fractional_bits": list(formats),
                "rounding_error": quantised.errors[name],
            }
            for name, formats in quantised.formats.items()
        },
        "provenance": {
            "canroll": version("canroll"),
            "vehicle": task.vehicle.title,
            "vehicle_sha256": task.vehicle.fingerprint,
            "vehicle_basis": task.vehicle.basis,
            "roll_model": task.vehicle.source("design"),
            **_law_origin(design.law),
        },
        VEHICLE: task.vehicle.document,
    }


def _law_origin(law: str) -> Tables:
    """Origin of the law and its code; empty if it is built in."""
    origin = LAWS.origin(law)
    return {} if origin.is_built_in else {"law_from": origin.who, "law_code": origin.where}


def _levels(design: Design) -> Tables:
    """The law's H∞ levels, if any, and its further numbers."""
    solution = design.solution
    named = {
        "gamma": solution.gamma,
        "gamma_bound": solution.gamma_bound,
        "rightmost_root": solution.rightmost_root,
    }
    return {name: value for name, value in named.items() if value is not None} | dict(
        solution.extra
    )
