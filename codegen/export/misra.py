"""Static analysis of the emitted C: cppcheck with its MISRA C:2012 addon, and deviations."""

import re
import subprocess
from pathlib import Path

DEVIATIONS = {
    "2.5": "constants have the names of the source; those that only array sizes, other constants "
    "or users of the headers need are not used in the code",
    "10.1": "bits are taken from signed integers: int32_t and int64_t are two's complement (C99 "
    "7.18.1.1), left shifts are of values shown not to be negative, and canroll_runtime.h refuses "
    "to compile where the right shift of a negative value loses its sign",
    "11.5": "the range check reads the calibration, words and bytes, as arrays of either, and "
    "init clears the state as an array of words: functions of canroll_runtime.h, whose word may "
    "alias any field (GNU attribute may_alias); the services read and write records by bytes, "
    "which may alias any object (C99 6.5), and seal a page by such a word",
    "15.5": "refusals return early, which keeps the rest of a function free of nesting",
}
"""Rules that the emitted C deviates from, and why that is safe; all others hold."""

CHECKS = "warning,style,performance,portability"


def cppcheck(source: Path, include: Path) -> dict[str, list[str]]:
    """Findings by rule: a MISRA rule's number or the name of a built-in check of cppcheck."""
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
