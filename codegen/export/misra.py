"""Static analysis of the emitted C: cppcheck with its MISRA C:2012 addon, and what deviates."""

import re
import subprocess
from pathlib import Path

DEVIATIONS = {
    "2.3": "the typedef in canroll_runtime.h is a check at compile time and has no other use",
    "2.4": "enumerations are constants here; their tags are absent on purpose",
    "5.7": "reported for enumerations without a tag, which can't be repeated",
    "8.9": "a table stands beside the functions of its stage, as in the source",
    "10.1": "bits are taken from signed values that are not negative; the right shift of negative "
    "values is checked at compile time to keep the sign",
    "10.4": "constants of anonymous enumerations are compared with the integers they are kept in",
    "10.8": "every operation is shown by the overflow proof to fit the type it is computed in: the "
    "cast widens a value that already fits",
    "11.5": "the range check reads the calibration, words and bytes, as arrays of either, and "
    "init clears the state as an array of words",
    "12.1": "products bind closer than sums, quotients in order: no further brackets are needed",
    "15.5": "refusals return early, which keeps the rest of a function free of nesting",
    "15.7": "a chain of conditions without a final else has nothing to do there",
}
"""Rules that the emitted C deviates from, and why that is safe; all others hold."""

CHECKS = "warning,style,performance,portability"


def cppcheck(source: Path, include: Path) -> dict[str, list[str]]:
    """Findings by rule: a MISRA rule's number or the name of a check of cppcheck's own."""
    command = ["cppcheck", "--addon=misra", "--std=c99", f"--enable={CHECKS}", "--quiet", "-j2"]
    command += ["--suppress=unusedFunction", f"-I{include}", str(source)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    found: dict[str, list[str]] = {}
    for line in result.stderr.splitlines():
        match = re.match(r"(\S+:\d+):\d+: .*\[(?:misra-c2012-)?([\w.]+)\]$", line)
        if match:
            found.setdefault(match[2], []).append(match[1])
    return found


def table() -> str:
    """The deviations as Markdown."""
    rows = [f"| {rule} | {reason} |" for rule, reason in DEVIATIONS.items()]
    return "\n".join(["| MISRA C:2012 rule | why the code deviates |", "| --- | --- |", *rows])
