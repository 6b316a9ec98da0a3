"""``canroll certify``: a certificate of a calibration, checked by the shipped checker."""

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from canroll import vehicles
from canroll.cases.engine import LOCAL, engine
from canroll.cli import terminal
from canroll.cli.options import choices_of
from canroll.errors import CanrollError, optional, reason, writing
from canroll.firmware.calibration import Q_MOMENT
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.calibration.resolution import of_bus, of_contract
from canroll.gain_gen.margin_report import task_of
from canroll.gain_gen.models.task import Task
from canroll.plant_sim.can_bus.network.own_frames import bus_map
from canroll.report.staging import check_parent
from canroll.setup.bus_frames import profile_of
from canroll.setup.choices import check as check_choices
from canroll.setup.controller import COMMANDS
from canroll.setup.delay import sample_to_force
from canroll.typing import Progress

if TYPE_CHECKING:
    from canroll.extensions.certify.certificate import Certificate
    from canroll.extensions.certify.coverage import Shortfall

NAME = "certificate.json"
MOST = 3
"""Conditions without a proof that are looked into, those nearest to instability."""
LEVELS = {
    "level": "roll angle by a roll moment on the body, mean square, relative to the largest "
    "without control, nominal car: at most",
    "level with event trigger": "the same with the event trigger: at most",
    "level without delay": "the papers' inequalities on the 1-DOF roll model, at the stored gain, "
    "from [a_y, bank, disturbance] to roll + roll rate: without delay γ ≤",
    "level with delay": "the same with every delay up to the longest and the tick that a command "
    "is held: γ ≤",
    "level with delay and event trigger": "the same with the event trigger's relative threshold: "
    "γ ≤",
}
SIMULATED = (
    "limits of slew and corners, tyres beyond their linear range, faults, and lost frames "
    "of the sensors: they remain simulation"
)


def run(args: argparse.Namespace) -> int:
    """Certify, check and report; 1 where the loop that runs is not proved in every condition."""
    optional("flint", "canroll certify", "certify")
    from canroll.extensions.certify.coverage import least_stable, shortfall  # noqa: PLC0415 - extra

    calibration = calibration_file.load(args.calibration)
    if args.check is not None:
        return _compared(args, calibration)
    path = None if args.json and args.out is None else _certificate(args.out, calibration)
    task = _task(args, calibration)
    with terminal.progress(quiet=args.json) as report:
        certificate = _certified(task, calibration, report)
    worst = least_stable(certificate.unproved, calibration, task.delay.most)[:MOST]
    missing = [shortfall(member, task, calibration, certificate.delay) for member in worst]
    text = json.dumps(certificate.content, indent=1, ensure_ascii=False).encode()
    if path is not None:
        with writing(path):
            path.write_bytes(text + b"\n")
        text = path.read_bytes()
    with terminal.progress(quiet=args.json) as report:
        took = _check(text, calibration, report)
    parts = [
        *lines(certificate, missing, task, calibration),
        f"checked again from the file by checker.py in {took:.1f} s",
        f"written: {path}",
    ]
    data = to_json(certificate, missing, task, calibration.law, path)
    return terminal.emit(args, data, parts, good=certificate.proved)


def _certified(task: Task, calibration: LoadedCalibration, report: Progress) -> "Certificate":
    """Return the certificate; its conditions are proved on all cores."""
    from canroll.extensions.certify.certificate import certify  # noqa: PLC0415 - needs the extra

    with engine(LOCAL, os.cpu_count() or 1) as pool:

        def over(work: Callable[..., Any], *columns: Iterable[Any]) -> Iterator[Any]:
            started = [pool.submit(work, *row) for row in zip(*columns, strict=True)]
            try:
                for number, future in enumerate(started):
                    report("proofs of one claim", number / len(started))
                    yield future.result()
            finally:  # of a claim that one condition lacks the others are not wanted
                for future in started:
                    future.cancel()

        return certify(task, calibration, over)


def _check(text: bytes, calibration: LoadedCalibration, report: Progress) -> float:
    """Check what was written as a stranger would; return how long that took, s."""
    from canroll.extensions.certify import checker  # noqa: PLC0415 - needs the extra

    begin = perf_counter()
    content, integers = checker.read(text, calibration.path.read_bytes())
    claims = sum(map(len, content["proved"].values()))
    for number, _ in enumerate(checker.check(content, integers)):
        # an error here is one of the proof itself
        report("checker", number / (1 + claims))
    return perf_counter() - begin


def _compared(args: argparse.Namespace, calibration: LoadedCalibration) -> int:
    """Check a certificate, then compare it with vehicle and bus; 1 where either fails."""
    from canroll.extensions.certify import checker, comparison  # noqa: PLC0415 - need the extra

    try:
        text = args.check.read_bytes()
    except OSError as error:
        raise CanrollError(f"cannot read certificate {args.check}: {reason(error)}") from error
    task = _task(args, calibration)
    command = [sys.executable, "-P", "-X", "utf8", checker.__file__]
    command += [str(args.check), str(calibration.path)]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    print(done.stdout, end="")
    if done.returncode:
        return 1
    differences = list(comparison.differences(json.loads(text), task, calibration))
    for difference in differences:
        print(f"not that of {task.vehicle.reference} and its bus: {difference}")
    if not differences:
        print(
            f"compared: car, delays, resolutions and bounds of steering are those of "
            f"{task.vehicle.reference} and its bus"
        )
    return 1 if differences else 0


def _certificate(out: Path | None, calibration: LoadedCalibration) -> Path:
    """Return where the certificate goes: beside the calibration, in a folder, or a file."""
    path = calibration.path.with_name(NAME) if out is None else out
    path = path / NAME if path.is_dir() else path
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    return check_parent(path)


def _task(args: argparse.Namespace, calibration: LoadedCalibration) -> Task:
    """Return the task of the file, on another vehicle or bus if one is given."""
    task = task_of(calibration)
    if args.vehicle_set and args.vehicle is None:
        raise CanrollError("--vehicle-set changes the vehicle of --vehicle: give both")
    choices = choices_of(args, ("vehicle", "bus", "dbc", "map"))
    check_choices(choices)
    if "vehicle" in choices:
        task = replace(task, vehicle=vehicles.load(choices["vehicle"]))
    else:
        note = vehicles.note_of_change(calibration.vehicle, "calibration")
        if note:
            print(f"note: {note}", file=sys.stderr)
    if "bus" in choices or "dbc" in choices:
        command, profile = COMMANDS[calibration.record.actuator], profile_of(choices)
        delay = sample_to_force(task.vehicle, command, profile, tick=calibration.tick)
        own = bus_map(profile)
        task = replace(task, delay=delay, resolution=of_bus(own) if own else of_contract())
    return task


def lines(
    certificate: "Certificate",
    missing: "list[Shortfall]",
    task: Task,
    calibration: LoadedCalibration,
) -> Iterator[str]:
    """Yield the answer, then what is proved under which assumptions and what is not."""
    conditions = certificate.conditions
    where = f"in all {conditions} conditions"
    if certificate.draws:
        where += f" of the car and of each of {certificate.draws} cars drawn from its fit"
    extent = f"{1e3 * task.delay.least:.4g} to {1e3 * task.delay.most:.4g} ms"
    loop = f"{calibration.law} for {task.vehicle.reference}"
    limit = calibration.record.moment_max / (1 << Q_MOMENT)
    if certificate.every_tick and not certificate.proved:
        lacking = conditions - len(certificate.with_trigger)
        yield (
            f"NOT PROVED: {loop} with its event trigger, as it runs: no proof in {lacking} of "
            f"{conditions} conditions; design with --trigger every for the loop of the next line"
        )
    if not certificate.every_tick:
        yield (
            f"NOT PROVED: {loop}, delays of {extent} from sample to force: no proof in "
            f"{len(certificate.unproved)} of {len(certificate.content['conditions'])} conditions"
        )
        for short in missing:
            yield from _short(short)
    else:
        yield (
            f"proved: {loop} is stable for every sequence of delays of {extent} from sample to "
            f"force, a new one every tick, {where}, with the integers as stored and a command "
            "every tick"
        )
        roll, moment = certificate.worst("every tick")
        yield (
            "roundings of the code and resolutions of the bus alone keep the roll angle within "
            f"{_up(roll, 4)}° and the command within {_up(moment, 1)} N·m at the ticks"
        )
        if certificate.triggered is not None:
            yield _trigger(certificate, conditions, limit)
        yield _limited(certificate, conditions, limit)
        lost = f"up to {certificate.lost} commands in a row" if certificate.lost else "no command"
        yield f"it stays proved where {lost} may be lost again and again"
        yield _steered(certificate, limit)
        yield (
            f"in every claim {', '.join(certificate.ranges)} stay within the ranges from any state "
            "of which canroll prove shows that nothing overflows"
        )
    yield from _levels(certificate)
    if certificate.note:
        yield f"warning: the only condition is the 1-DOF roll model: {certificate.note}"
    for sentence in certificate.assumptions:
        yield f"assumed: {sentence}"
    if certificate.draws:
        yield "not proved of the drawn cars: anything but stability and roundings every tick"
    yield f"not proved: {SIMULATED}"


def _limited(certificate: "Certificate", conditions: int, limit: float) -> str:
    count = len(certificate.with_limit)
    if not count:
        return f"no proof in any condition of stability where the limit of {limit:.0f} N·m acts"
    trigger = "" if certificate.triggered is None else " with the event trigger's withheld commands"
    return (
        f"where its limit of {limit:.0f} N·m acts on the command the loop is stable as well,"
        f"{trigger} in {'all' if count == conditions else f'{count} of'} {conditions} conditions"
    )


def _steered(certificate: "Certificate", limit: float) -> str:
    if not certificate.steered:
        return "no proof that values of the code do not saturate in curves and on a bank"
    from canroll.extensions.certify.disturbed import BANK  # noqa: PLC0415 - needs the extra

    roll, moment = certificate.worst("steered")
    return (
        f"no other value that the code stores saturates with steering of up to "
        f"{certificate.steered:g} m/s² at any rate on a bank of up to "
        f"{100.0 * BANK:.0f} %: the roll angle stays within {_up(roll, 2)}° and the command before "
        f"its limit of {limit:.0f} N·m within {_up(moment, 0)} N·m"
    )


def _levels(certificate: "Certificate") -> Iterator[str]:
    for name, words in LEVELS.items():
        if name in certificate.levels:
            yield f"{words} {_up(certificate.levels[name], 4)}"


def _beyond(moment: float, limit: float) -> str:
    if moment <= limit:
        return ""
    return f", which is beyond the limit of {limit:.0f} N·m and so assumes a stronger actuator"


def _trigger(certificate: "Certificate", conditions: int, limit: float) -> str:
    names = certificate.with_trigger
    if not names:
        return "with the event trigger's withheld commands there is no proof in any condition"
    roll, moment = certificate.worst("event trigger")
    where = "all" if certificate.triggered else f"{len(names)} of {conditions}"
    text = (
        f"with the event trigger's withheld commands the same holds in {where} conditions, within "
        f"{_up(roll, 2)}° and {_up(moment, 0)} N·m there"
    )
    return text + _beyond(moment, limit)


def _short(short: "Shortfall") -> Iterator[str]:
    filtered = short.member.filtered
    delays = ", ".join(f"{1e3 * (d + filtered):.4g}" for d in short.sequence.delays)
    verdict = "unstable" if short.unstable else "closest to instability, though it decays"
    yield (
        f"  {short.member.condition}: {verdict} with delays of {delays} ms again and again: a "
        f"factor of {short.sequence.radius:.5f} a tick; simulated, a roll angle of 1° leaves up to "
        f"{short.simulated[0]:.3g}° in the third second and {short.simulated[1]:.3g}° in the fifth"
    )
    if short.most is not None:
        yield f"  proved there up to {1e3 * (short.most + filtered):.4g} ms"


def to_json(
    certificate: "Certificate",
    missing: "list[Shortfall]",
    task: Task,
    law: str,
    path: Path | None,
) -> dict[str, Any]:
    """Return the answer as plain numbers."""
    roll, moment = certificate.worst("every tick") if certificate.every_tick else (None, None)
    return {
        "proved": certificate.proved,
        "every_tick_proved": certificate.every_tick,
        "law": law,
        "vehicle": task.vehicle.reference,
        "delay_min_s": task.delay.least,
        "delay_max_s": task.delay.most,
        "roll_rounding_deg": roll,
        "moment_rounding_nm": moment,
        "draws": certificate.draws,
        "trigger_proved": certificate.triggered,
        "limited_proved": len(certificate.with_limit) == certificate.conditions,
        "commands_lost": certificate.lost,
        "steered_m_s2": certificate.steered,
        "levels": dict(certificate.levels),
        "conditions": [
            {
                "name": condition["name"],
                "claims": [
                    {
                        "name": claim["name"],
                        "delay_max_s": certificate.longest(condition, claim) + _filtered(task),
                        "decay_per_tick": math.sqrt(_number(claim["decay"])),
                        "roll_deg": math.degrees(_number(claim["roll_rad"])),
                        "moment_nm": _number(claim["moment_nm"]),
                    }
                    for claim in condition["claims"]
                ],
            }
            for condition in certificate.content["conditions"]
        ],
        "unproved": [
            {
                "name": str(short.member.condition),
                "proved_to_s": None if short.most is None else short.most + short.member.filtered,
                "unstable": short.unstable,
                "sequence_s": [d + short.member.filtered for d in short.sequence.delays],
                "growth_per_tick": short.sequence.radius,
            }
            for short in missing
        ],
        "assumptions": list(certificate.assumptions),
        "file": None if path is None else str(path),
    }


def _filtered(task: Task) -> float:
    """Part of a delay that the sensor's low-pass makes, s."""
    return 1.0 / (2.0 * math.pi * task.vehicle.sensors.roll_rate.bandwidth)


def _number(text: str) -> float:
    above, _, below = text.partition("/")
    return int(above) / int(below or 1)


def _up(value: float, digits: int) -> str:
    """Return a bound rounded up."""
    return f"{math.ceil(value * 10**digits) / 10**digits:.{digits}f}"
