"""``canroll prove``: absence of overflow, index errors and division by zero for any frames."""

import argparse
from time import perf_counter

from canroll.build_cache import key
from canroll.cli import terminal
from canroll.cli.options import choices_of
from canroll.codegen.proof import prove
from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import (
    BusFirmware,
    built_in,
    with_services,
    with_stage,
)
from canroll.codegen.run.service import SERVICES
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import check
from canroll.gain_gen.calibration import calibration_file
from canroll.setup.bus_frames import stage_of


def run(args: argparse.Namespace) -> int:
    """Run the proof; return 1 where an obligation isn't met."""
    loaded = None if args.calibration is None else calibration_file.load(args.calibration)
    stage = stage_of({} if loaded is None else loaded.tables, choices_of(args, ("stage",)))
    firmware = with_services(with_stage(built_in(), stage), tuple(SERVICES))
    name = str(args.calibration or "every calibration accepted by the ECU")
    record = None if loaded is None else loaded.record
    return report(args, record, firmware, name)


def report(
    args: argparse.Namespace, record: Calibration | None, firmware: BusFirmware, name: str
) -> int:
    """Prove ``firmware`` for ``record`` and print what was shown, or each line that fails."""
    if firmware.stage is not None:
        name = f"{name}, stage {firmware.stage.file}"
    if record is not None:
        refused = check(record)
        if refused:
            raise CanrollError(f"{name}: rejected by rule {refused} of the ECU's check")
    try:
        expressions, took = firmware.kept(
            f"proof {key(record)!r}", lambda: proved(record, firmware)
        )
        findings: list[str] = []
    except NotProvedError as failed:  # made anew each time: its places may be of files of this run
        findings, expressions, took = failed.findings, failed.expressions, failed.took
    answer = {"proved": not findings, "for": name, "expressions": expressions}
    text = (
        f"proved for {name}: from any state in the declared ranges and any frames, no overflow of "
        f"64 bits, no value out of its field, no bad index, no zero divisor "
        f"({expressions} expressions, {took:.1f} s)"
    )
    if findings:
        text = f"not proved: {len(findings)} places in {took:.1f} s"
    for finding in () if args.json else findings:
        terminal.note(finding)
    data = answer | {"findings": findings, "seconds": took}
    return terminal.emit(args, data, [text], good=not findings)


class NotProvedError(Exception):
    """A proof that fails: its findings in words, its number of expressions, its time in s."""

    def __init__(self, findings: list[str], expressions: int, took: float) -> None:
        super().__init__(f"{len(findings)} places")
        self.findings, self.expressions, self.took = findings, expressions, took


def proved(record: Calibration | None, firmware: BusFirmware) -> tuple[int, float]:
    """Return the number of expressions shown to be safe, and the time that took, s.

    Raises:
        NotProvedError: some are not.
    """
    begin = perf_counter()
    exact = None if record is None else memory_image.elements(record)
    proof = prove.prove(firmware.program(), calibration=exact)
    took = perf_counter() - begin
    if proof.findings:
        raise NotProvedError([str(finding) for finding in proof.findings], len(proof.seen), took)
    return len(proof.seen), took
