"""An engineer's own stage: source to proof to C, the same on every back end, refused by line."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.replays import compare, python_states, replayed

from canroll.codegen.c99 import emit
from canroll.codegen.export import interrupts
from canroll.codegen.generated import own_stage
from canroll.codegen.generated.own_stage import OwnStage
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import bus_firmware, cortex, ecu_traffic, memory_image, native
from canroll.codegen.run import qemu as qemu_run
from canroll.codegen.run import unicorn as unicorn_run
from canroll.codegen.subset.program import FIRMWARE, copy_sources, source_files
from canroll.errors import CanrollError
from canroll.firmware.calibration import (
    COMPENSATOR,
    OUTPUT_FEEDBACK,
    STATE_FEEDBACK,
    STATE_MAX,
    Calibration,
)
from canroll.firmware.state import ACTIVE, DEGRADED, Ecu
from canroll.firmware.subset import fields

EXAMPLE = Path(__file__).parents[3] / "examples" / "own_stage" / "progressive.py"
STAGE = own_stage.read(EXAMPLE)

HEAD = """\
\"\"\"Sample.\"\"\"
from typing import Annotated
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import F, clamp, clear, i32, i64, record, sat31, u8


"""
MOMENT = "def moment(ecu: Ecu, cal: Calibration, wanted: i32, output: i32, steps: i32) -> i32:\n"
ESTIMATE = "def estimate(ecu: Ecu, cal: Calibration, steps: i32) -> None:\n"
HELPER = """def twice(ecu: Ecu) -> None:
    for i in range(2):
        ecu.x[i] = 0


"""
OWN = '@record\nclass Own(Ecu):\n    """State."""\n\n'


def nested(*rounds, call=False):
    """Return loops in each other as the body of a function."""
    lines = [f"{'    ' * (k + 1)}for k{k} in range({n}):" for k, n in enumerate(rounds)]
    inside = "twice(ecu)" if call else "ecu.x[1] = 0"
    return "\n".join([*lines, f"{'    ' * (len(rounds) + 1)}{inside}", ""])


needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")


def staged(source, file="own.py", firmware=None):
    path = Path(file)
    stage = OwnStage(path.name, source, path.parent)
    return bus_firmware.with_stage(firmware or bus_firmware.built_in(), stage)


@pytest.fixture(scope="module")
def firmware():
    return bus_firmware.with_stage(bus_firmware.built_in(), STAGE)


def calibration(seed, **changes):
    record = ecu_traffic.random_calibration(seed)
    for name, value in changes.items():
        setattr(record, name, value)
    return memory_image.sealed(record)


def working(firmware, traffic, **changes):
    """The first calibration with which the stage works while the loop does."""
    for seed in range(30):
        record = calibration(seed, init_ticks=1, **changes)
        states = replayed(native.library_of(firmware), record, traffic).states[0]
        if np.isin(states["mode"][states["swing"] != 0], [ACTIVE, DEGRADED]).any():
            return record
    pytest.fail("no calibration lets the stage work")


def active(firmware, traffic, **changes):
    """The first calibration with wide limits with which the loop works in ten ticks or more."""
    for seed in (seed for seed in range(45) if seed % ecu_traffic.TIGHT):
        record = calibration(seed, init_ticks=1, **changes)
        modes = [ecu.mode for ecu in python_states(firmware, record, traffic)]
        if modes.count(ACTIVE) + modes.count(DEGRADED) >= 10:
            return record
    pytest.fail("no calibration lets the loop work")


def test_without_a_stage_the_c_has_nothing_of_it(tmp_path):
    copy_sources(tmp_path)
    for path in source_files(tmp_path):
        lines = path.read_text().splitlines()
        kept = [s for s in lines if "stage." not in s and s != "from canroll.firmware import stage"]
        path.write_text("\n".join([*kept, ""]))
    (tmp_path / "stage.py").unlink()
    assert "stage.moment" in (FIRMWARE / "control_law.py").read_text()
    assert emit.emit(folder=tmp_path) == emit.firmware()
    assert not any("stage" in name for name in emit.firmware())


def test_the_places_of_a_stage_do_nothing_by_default():
    loop = bus_firmware.built_in().module("stage")
    ecu, cal = Ecu(), Calibration()
    before = memory_image.image(ecu)
    assert loop.moment(ecu, cal, -5, 1, 3) == -5
    for hook in (loop.start, loop.rest):
        assert hook(ecu, cal) is None
    assert loop.estimate(ecu, cal, 1) is None
    assert memory_image.image(ecu) == before


@pytest.mark.slow
def test_its_state_follows_that_of_the_loop(firmware):
    ours, its = memory_image.dtype(Ecu), memory_image.dtype(firmware.record)
    assert [f.name for f in fields(firmware.record)][-2:] == ["swing", "factor"]
    assert all(its.fields[name] == ours.fields[name] for name in ours.names)
    assert "swing; /* largest roll angle of late, rad Q30 */" in firmware.files["canroll_state.h"]


def test_the_example_is_proved_and_keeps_the_contract_of_the_interrupt(firmware):
    program = firmware.program()
    assert prove(program).findings == ()
    assert interrupts.table(program) == interrupts.table()
    assert firmware.files["canroll_stage.c"].startswith("/* Generated from progressive.py. */")


def test_the_example_is_quiet_for_small_angles_and_whole_for_large_ones(firmware):
    stage, ecu, cal = firmware.module("stage"), firmware.record(), Calibration()
    stage.start(ecu, cal)
    degree = np.pi / 180 * (1 << 30)
    wanted = 1000 << 14
    ecu.x[0] = round(0.05 * degree)
    assert stage.moment(ecu, cal, wanted, 0, 1) == wanted // 4
    ecu.x[0] = round(-0.35 * degree)
    assert stage.moment(ecu, cal, wanted, 0, 1) == pytest.approx(wanted * 5 / 8, rel=1e-4)
    ecu.x[0] = round(0.7 * degree)
    assert stage.moment(ecu, cal, -wanted, 0, 1) == -wanted
    ecu.x[0] = 0
    assert stage.moment(ecu, cal, wanted, 0, 1) == wanted
    for _ in range(200):
        last = stage.moment(ecu, cal, wanted, 0, 1)
    assert last == wanted // 4
    ecu.x[0] = round(0.7 * degree)
    stage.moment(ecu, cal, wanted, 0, 1)
    stage.rest(ecu, cal)
    assert (ecu.swing, ecu.factor) == (0, 1 << 14)


@needs_cc
@pytest.mark.parametrize("law", [STATE_FEEDBACK, OUTPUT_FEEDBACK, COMPENSATOR])
def test_native_is_python(firmware, law):
    traffic = ecu_traffic.random_traffic(law, 60)
    compare(
        firmware, working(firmware, traffic, law=law, actuator=0, compensator_outputs=1), traffic
    )


@pytest.mark.slow
@needs_cc
@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
def test_cortex_m4_is_native(firmware):
    record, traffic = calibration(5), ecu_traffic.random_traffic(5, 12)
    run = unicorn_run.replay(record, traffic, "cortex-m4", firmware)
    expected = replayed(native.library_of(firmware), record, traffic)
    assert run.states.tobytes() == expected.states[0].tobytes()
    assert run.frames.tobytes() == expected.frames.tobytes()


@pytest.mark.slow
@needs_cc
@pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs arm-none-eabi-gcc and QEMU")
def test_qemu_is_native(firmware):
    record, traffic = calibration(6), ecu_traffic.random_traffic(6, 60)
    run = qemu_run.replay(record, traffic, "cortex-m4", firmware=firmware)
    expected = replayed(native.library_of(firmware), record, traffic)
    assert run.states.tobytes() == expected.states[0].tobytes()
    assert run.frames.tobytes() == expected.frames.tobytes()


@pytest.mark.slow
def test_what_a_stage_gives_is_limited_as_what_a_law_gives():
    least = staged(HEAD + MOMENT + '    """Least."""\n    return -2147483647\n')
    limits = {"moment_max": 500 << 14, "slew_max": 300 << 14, "ramp_ticks": 1}
    limits |= dict.fromkeys(("envelope_moment", "envelope_slew", "envelope_outward"), STATE_MAX)
    limits |= {"schedule_gain": [1 << 28] * 8, "fade_low": 0, "fade_high": 1}
    traffic = ecu_traffic.random_traffic(5, 60)
    record = active(least, traffic, law=STATE_FEEDBACK, actuator=0, compensator_outputs=1, **limits)
    seen = [(ecu.moment, ecu.mode) for ecu in python_states(least, record, traffic)]
    moments, modes = np.array(seen).T
    assert min(moments) == -limits["moment_max"]
    # at its start the law takes over what is delivered
    goes_on = np.isin(modes[:-1], (ACTIVE, DEGRADED))
    rises = np.diff(moments) / np.clip(traffic.elapsed[1:], 1, 16)
    assert min(rises[goes_on]) == -limits["slew_max"]


@pytest.mark.slow
def test_a_law_with_two_outputs_has_two_calls():
    text = OWN + '    calls: Annotated[list[i32], 2, F(0, 100, 0, "", "calls")]\n\n\n'
    text += MOMENT.replace("ecu: Ecu", "ecu: Own") + '    """Count."""\n'
    text += "    k: i32 = clamp(output, 0, 1)\n"
    text += "    ecu.calls[k] = clamp(ecu.calls[k] + 1, 0, 100)\n    return wanted\n"
    its = staged(HEAD + text)
    traffic = ecu_traffic.random_traffic(1, 60)
    record = active(its, traffic, law=COMPENSATOR, actuator=1, compensator_outputs=2, observer=1)
    states = [list(ecu.calls) for ecu in python_states(its, record, traffic)]
    assert states[-1][0] == states[-1][1] > 0


@pytest.mark.slow
def test_an_estimator_corrects_what_the_law_reads():
    text = ESTIMATE + '    """No roll."""\n    ecu.x[0] = 0\n'
    its = staged(HEAD + text)
    traffic = ecu_traffic.random_traffic(0, 60)
    record = active(its, traffic, observer=0, law=STATE_FEEDBACK, actuator=0, compensator_outputs=1)
    seen = set()
    for ecu in python_states(its, record, traffic):
        assert ecu.x[0] == 0
        seen.add(ecu.reference_roll)
    assert len(seen) > 1


@pytest.mark.slow
def test_loops_in_each_other_may_have_4096_rounds():
    assert "canroll_stage.c" in staged(HEAD + ESTIMATE + nested(64, 64)).files


@pytest.mark.slow
def test_a_stage_runs_on_a_bus_of_its_own():
    folder = EXAMPLE.parents[1] / "own_bus"
    own = bus_firmware.of_bus(folder / "own.dbc", folder / "own.toml")
    its = bus_firmware.with_stage(own, STAGE)
    assert its.files["canroll_signals.c"] == own.files["canroll_signals.c"]
    assert "canroll_stage.c" in its.files and its.slots == own.slots


def own(field, hook=ESTIMATE + "    ecu.x[0] = 0\n"):
    """A stage with a field of its own."""
    return f"{OWN}    {field}\n{hook}"


@pytest.mark.parametrize(
    ("text", "line", "rule"),
    [
        ("import numpy\n", 8, "only canroll.firmware is imported, not numpy"),
        (
            "from canroll.firmware.state import Nothing\n",
            8,
            "canroll.firmware.state has no Nothing",
        ),
        (
            "from canroll.firmware.nothing import x\n",
            8,
            "there is no module canroll.firmware.nothing",
        ),
        ("def moment(:\n", 8, "invalid syntax"),
        ("X = 1\n", 1, "a stage defines at least one of start, estimate, moment, rest"),
        ("def rest(ecu: Ecu) -> None:\n    ecu.x[0] = 0\n", 8, "must be: def rest(ecu: Ecu"),
        (MOMENT + "    return wanted * 1.5\n", 9, "1.5"),
        (MOMENT + "    return wanted * steps\n", 9, "i32"),
        (ESTIMATE + "    for k in range(ecu.x[0]):\n        ecu.x[k] = 0\n", 9, "bound"),
        (
            ESTIMATE + "    n: i32 = ecu.x[0]\n    for _ in range(n):\n        ecu.x[1] = 0\n",
            10,
            "a loop of up to 1073741823 rounds: limit it to 64",
        ),
        (ESTIMATE + nested(64, 64, 2), 11, "make up to 8192 rounds: limit them to 4096"),
        (
            ESTIMATE + nested(64, 64, 64, 64, 64, 64),
            11,
            "loops in each other make up to 262144 rounds: limit them to 4096",
        ),
        (HELPER + ESTIMATE + nested(64, 33, call=True), 9, "make up to 4224 rounds"),
        (ESTIMATE + "    ecu.x[5] = 0\n", 9, "not proved: index of 5 elements: [5, 5]"),
        (ESTIMATE + "    ecu.mode = 1\n", 9, "a stage stores in its own fields and in ecu.x"),
        (ESTIMATE + "    clear(ecu)\n", 9, "a stage stores in its own fields"),
        (
            "from canroll.firmware.plausibility import latch_faults\n"
            f"{ESTIMATE}    latch_faults(ecu)\n",
            10,
            "a stage stores in its own fields",
        ),
        (
            ESTIMATE + "    k: i32 = ecu.rx_payload[0][0]\n    ecu.x[0] = k\n",
            9,
            "an interrupt writes ecu.rx_payload",
        ),
        (own('mode: Annotated[i32, F(0, 9, 0, "", "")]'), 12, "Ecu has a field mode already"),
        (own('low: Annotated[i32, F(1, 9, 0, "", "")]'), 12, "low starts at 0, which is outside"),
        (own('int: Annotated[i32, F(0, 9, 0, "", "")]'), 12, "'int' has another meaning in C"),
        (own('n: Annotated[i32, F(0, 9, 0, "")]'), 12, "F takes"),
        (
            own("n: i32").replace("(Ecu)", ""),
            9,
            "a stage's own fields are in one '@record class Own(Ecu)'",
        ),
        (
            own(
                'n: Annotated[i32, F(0, 9, 0, "", "")]\n\n',
                ESTIMATE.replace("Ecu", "Own") + "    ecu.n = steps\n",
            ),
            16,
            "not proved: does not fit n is declared in [0, 9]: [1, 16]",
        ),
    ],
)
def test_what_is_no_stage_is_refused_with_file_and_line(text, line, rule):
    with pytest.raises(CanrollError) as refused:
        staged(HEAD + text, "folder/own.py")
    message = str(refused.value)
    assert message.startswith(f"folder/own.py:{line}: ") and rule in message
    assert "\n" not in message


SPRING = "__import__('pathlib').Path('sprung').touch()"


@pytest.mark.parametrize(
    "text",
    [
        f"__all__ = [{SPRING}]\n" + HEAD + ESTIMATE + "    ecu.x[0] = 0\n",
        HEAD
        + f"def zero(row: Annotated[list[i32], 4, F({SPRING})]) -> i32:\n    return 0\n\n\n"
        + ESTIMATE
        + "    ecu.x[0] = 0\n",
        # that imports in another encoding than the one it is checked in
        f"# coding: utf-7\n# +AAo-{SPRING}\n" + HEAD + ESTIMATE + "    ecu.x[0] = 0\n",
        # all of whose functions do nothing, so that no pass keeps the module
        f"__all__ = [{SPRING}]\n" + HEAD + MOMENT + "    return wanted\n",
    ],
)
def test_a_stage_executes_nothing_as_it_is_read(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CanrollError, match=r"(own|stage)\.py:\d+: .*") as refused:
        _ = staged(text).loop
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "sprung").exists()


@needs_cc
def test_a_text_of_a_stage_is_no_code_in_c():
    """What would end a comment in C is shown there as something else."""
    text = "*\\\\ static int own; \\\\*"
    body = MOMENT + f'    """{text}"""\n    return sat31(wanted - 1)\n'
    assert "*/ static" not in staged(HEAD + body).files["canroll_stage.c"]


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(CanrollError, match=r"cannot read stage .*none\.py: No such file"):
        own_stage.read(tmp_path / "none.py")
    (tmp_path / "latin.py").write_bytes(b"\xe9")
    with pytest.raises(CanrollError, match=r"latin\.py: not UTF-8"):
        own_stage.read(tmp_path / "latin.py")


def test_the_example_also_runs_as_plain_python(tmp_path):
    shutil.copy(EXAMPLE, tmp_path)
    scope = {"__name__": "progressive"}
    exec(compile(EXAMPLE.read_text(), str(EXAMPLE), "exec"), scope)
    ecu = scope["Progressive"]()
    scope["start"](ecu, Calibration())
    assert ecu.factor == 1 << 14
