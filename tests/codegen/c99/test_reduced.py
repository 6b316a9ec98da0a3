"""A small loop for one calibration: what never happens is gone, what comes late or rarely stays."""

import shutil
import subprocess

import pytest

from canroll.codegen.c99 import emit
from canroll.codegen.subset.parse import load
from canroll.errors import CanrollError

STATE = """
from typing import Annotated
from canroll.firmware.subset import F, i32, record, u8


@record
class Ecu:
    '''State.'''

    refused: Annotated[i32, F(0, 511, 0, "", "")]
    count: Annotated[i32, F(0, 5000, 0, "", "")]
    late: Annotated[i32, F(0, 300, 0, "", "")]
    off: Annotated[i32, F(-9, 300, 0, "", "")]
    pair: Annotated[list[i32], 2, F(0, 400, 0, "", "")]
    given: Annotated[u8, F(0, 255, 0, "", "", True)]


@record
class Calibration:
    '''Numbers.'''

    most: Annotated[i32, F(0, 1000, 0, "", "")]
    table: Annotated[list[i32], 2, F(0, 9, 0, "", "")]
    option: Annotated[u8, F(0, 1, 0, "", "")]
"""
LOOP = """
'''A loop.'''
from canroll.firmware.state import Calibration, Ecu
from canroll.firmware.subset import byte, clamp, clear, i32

__all__ = ["init", "receive", "tick"]


def init(ecu: Ecu, cal: Calibration) -> i32:
    '''Start.'''
    clear(ecu)
    if cal.most > 990:
        ecu.refused = 1
        return 1
    ecu.pair[0] = 3
    return 0


def receive(ecu: Ecu, value: i32) -> None:
    '''Take.'''
    ecu.given = byte(value)


def counted(ecu: Ecu, most: i32) -> i32:
    '''Count, and return whether it is the last time.'''
    ecu.count = clamp(ecu.count + 1, 0, most)
    if ecu.count == most:
        return 1
    return 0


def tick(ecu: Ecu, cal: Calibration, k: i32) -> None:
    '''Run.'''
    if ecu.refused != 0:
        return
    # the option
    if cal.option == 1:
        step: i32 = ecu.count & 7
        ecu.off = step - 9
    else:
        step: i32 = 300
        ecu.off = step
    if counted(ecu, cal.most) == 1 and cal.option == 0:
        step: i32 = cal.table[k & 1]
        ecu.pair[1] = step
    if ecu.count == 700:
        ecu.late = 200
    unread: i32 = ecu.given
    if cal.option == 1:
        ecu.late = unread
    ecu.pair[1] = clamp(ecu.pair[1] + ecu.pair[0] + ecu.late, 0, 400)
"""
SERVICE = """
'''A service that writes the state of the loop.'''
from canroll.firmware.state import Ecu
from canroll.firmware.subset import i32


def set(ecu: Ecu, value: i32) -> None:
    '''Set.'''
    if value > 0:
        ecu.pair[0] = 4
"""
MAIN = """
#include "canroll.h"
#include <stdio.h>
#include <string.h>

int main(void)
{
    static canroll_ecu ecu;
    static const canroll_calibration cal = { %s };
    memset(&ecu, 0, sizeof ecu);
    printf("%%d\\n", canroll_init(&ecu, &cal));
    for (int k = 0; k < 2000; k++) {
        canroll_receive(&ecu, k);
        %s
        canroll_tick(&ecu, &cal, k);
        fwrite(&ecu, sizeof ecu, 1, stdout);
    }
    return 0;
}
"""
FLAGS = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wshadow", "-Werror"]


def program(folder, services=()):
    (folder / "state.py").write_text(STATE.lstrip("\n"))
    (folder / "ecu.py").write_text(LOOP.lstrip("\n"))
    (folder / "services").mkdir(exist_ok=True)
    (folder / "services" / "service.py").write_text(SERVICE.lstrip("\n"))
    return load("ecu", folder, services=services)


def numbers(most, option):
    values = {("most", ()): most, ("option", ()): option}
    return values | {("table", (k,)): number for k, number in enumerate((5, 2))}


def of(folder, most, option, services=()):
    return emit.translated_for(program(folder, services), numbers(most, option))


def output(folder, files, most, option, called=""):
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "main.c").write_text(MAIN % (f"{most}, {{ 5, 2 }}, {option}", called))
    command = ["gcc", *FLAGS, "-o", "main", *sorted(n for n in [*files, "main.c"] if n[-1] == "c")]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    return subprocess.run([folder / "main"], capture_output=True, check=True, timeout=60).stdout


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
@pytest.mark.parametrize("most", [0, 1, 300, 700, 990, 991])
@pytest.mark.parametrize("option", [0, 1])
def test_the_state_is_that_of_the_general_code(tmp_path, most, option):
    general = output(tmp_path / "any", emit.translated(program(tmp_path)), most, option)
    one = output(tmp_path / "one", of(tmp_path, most, option), most, option)
    assert one == general


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_what_a_service_stores_counts(tmp_path):
    call = "if (k == 1500) { canroll_service_set(&ecu, k); }"
    general = emit.translated(program(tmp_path, ["service"]))
    one = of(tmp_path, 700, 0, ["service"])
    assert one["canroll_service.c"] == general["canroll_service.c"]
    outputs = [
        output(tmp_path / name, files, 700, 0, call)
        for name, files in (("any", general), ("one", one))
    ]
    assert outputs[0] == outputs[1]
    assert outputs[0] != output(tmp_path / "none", general, 700, 0)


def test_what_never_happens_is_gone_and_what_comes_late_stays(tmp_path):
    short, long = (of(tmp_path, most, 0)["canroll_ecu.c"] for most in (699, 700))
    assert "ecu->late = 200;" in long
    assert "ecu->late" not in short
    for text in (short, long):
        assert "ecu->off = 300;" in text
        assert "unread" not in text and "cal->" not in text
        assert "ecu->pair[0] = 3;" in text and "ecu->pair[1] + 3" in text
    assert "200" not in short


def test_a_refused_calibration_never_runs(tmp_path):
    text = of(tmp_path, 991, 0)["canroll_ecu.c"]
    assert "ecu->refused = 1;" in text
    assert "counted" not in text


def test_what_is_not_proved_is_refused(tmp_path):
    (tmp_path / "services").mkdir()
    wrong = LOOP.replace("ecu.late = 200", "ecu.late = 301")
    (tmp_path / "state.py").write_text(STATE.lstrip("\n"))
    (tmp_path / "ecu.py").write_text(wrong.lstrip("\n"))
    with pytest.raises(CanrollError, match=r"not proved: .*late is declared in \[0, 300\]"):
        emit.translated_for(load("ecu", tmp_path), numbers(700, 0))
    # with a count that ends before it never is
    emit.translated_for(load("ecu", tmp_path), numbers(699, 0))
