"""From design to integers and back: formats, file, errors, header, command line."""

import json
import re
import subprocess
import tomllib
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from canroll import vehicles
from canroll.cli.main import main
from canroll.codegen.c99.text import plain
from canroll.codegen.export.header import gains_header
from canroll.codegen.run.memory_image import sealed
from canroll.errors import CanrollError, UnknownNameError, VerdictError
from canroll.firmware.calibration import COEFFICIENT, STATE_MAX, Calibration
from canroll.firmware.check import check
from canroll.firmware.subset import fields
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.dequantise import dequantise, physical_notes
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.calibration.options import QuantiseOptions
from canroll.gain_gen.calibration.record import fill, flatten, identify, packed
from canroll.gain_gen.calibration.rounding_error import integer_loop, manoeuvre_error, measured
from canroll.gain_gen.calibration.rows import quantise, quantise_row
from canroll.gain_gen.calibration.summary import summary, title
from canroll.gain_gen.calibration.vehicle_part import damper_knee, moment_limit
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.margin_report import margin_report
from canroll.gain_gen.models.controller import matrices
from canroll.gain_gen.models.task import Delay, Task
from canroll.vehicles import load


def task(vehicle="van_real", delay=0.02, **options):
    return Task(load(vehicle), Delay.constant(delay), **options)


@pytest.fixture(scope="module")
def lqr():
    return design("lqr", task())


@pytest.fixture(scope="module")
def calibrated(lqr):
    return calibrate(lqr)


@given(
    values=st.lists(
        st.floats(-1e6, 1e6).filter(lambda v: v == 0.0 or abs(v) > 1e-9), min_size=1, max_size=6
    ),
    result=st.integers(10, 30),
)
def test_rows_keep_their_values_and_their_bounds(values, result):
    """Either the row is refused, or each coefficient is exact to half a unit of its format."""
    factors = tuple(24 + i for i in range(len(values)))
    try:
        row = quantise_row(np.array(values), factors, result, name="row")
    except CanrollError as error:
        assert "row" in str(error)
        return
    assert max(abs(n) for n in row.stored) <= COEFFICIENT
    assert sum(abs(n) for n in row.stored) * STATE_MAX + (1 << row.shift) < 1 << 62
    assert 1 <= row.shift <= 62
    for value, n, q in zip(values, row.stored, row.formats, strict=True):
        assert abs(n * 2.0**-q - value) <= 0.5000001 * 2.0**-q + 1e-15 * abs(value)


def test_a_coefficient_that_does_not_fit_is_refused_by_name():
    with pytest.raises(CanrollError, match="gain"):
        quantise_row(np.array([1e12]), (14,), 30, name="gain")
    with pytest.raises(CanrollError, match="not a number"):
        quantise_row(np.array([np.nan]), (14,), 14, name="gain")
    with pytest.raises(CanrollError, match=r"speed: 9 is outside 0 to 8"):
        quantise(9.0, 4, 0, 128, name="speed")


@pytest.mark.parametrize(
    ("law", "vehicle"),
    [
        ("hinf_delay", "van_real"),
        *product(
            ["lqg_delay", "hinf", "lqr", "smc", "ay_feedforward"],
            ["van_2021", "van_real", "suv_2020"],
        ),
    ],
)
def test_every_law_is_accepted_by_the_ecu_and_keeps_its_response(law, vehicle):
    answer = design(law, task(vehicle))
    record, tables = calibrate(answer)
    assert check(record) == 0
    assert answer.is_verified
    exact = matrices(answer.controller)
    integers = matrices(dequantise(record))
    for one, other in zip(exact, integers, strict=True):
        size = 1.0 + np.abs(one).max(initial=0.0)
        np.testing.assert_allclose(other, one, rtol=2e-5, atol=1e-7 * size)
    assert tables["verification"]["quantised_moment_nm"]["value"] < 0.1


def test_integer_loop_is_the_firmware_and_a_wrong_gain_shows(lqr, calibrated):
    """The moment error must notice a coefficient that is off by one part in a thousand."""
    record, _ = calibrated
    assert manoeuvre_error(lqr, record) < 0.05
    spoiled = fill({field.name: getattr(record, field.name) for field in fields(Calibration)})
    spoiled.feedback[0] = round(spoiled.feedback[0] * 1.001)
    assert manoeuvre_error(lqr, spoiled) > 1.0
    inputs = measured(lqr, 1e4)
    assert np.abs(inputs[:, 1]).max() > 3.0
    advance = integer_loop(record)
    assert all(advance(np.zeros(4)) == 0.0 for _ in range(3))


def test_identification_scales_rebuild_the_nominal_model():
    """model_scale times the Taylor entries of the nominal plant gives phi and gamma again."""
    answer = design("lqr", task("suv_2020"))
    record, _ = calibrate(answer, QuantiseOptions(identification=True))
    a = record.model_stiffness / 2**30
    b = record.model_damping / 2**30
    square = b * b - a
    taylor = {
        (0, 0): 1 - a / 2 + a * b / 6,
        (0, 1): 1 - b / 2 + square / 6,
        (1, 0): a * b / 2 - a - a * square / 6,
        (1, 1): 1 - b + square / 2 + (a * b - b * square) / 6,
    }
    for (i, j), value in taylor.items():
        assert record.model_scale[i][j] * value == pytest.approx(record.phi[i][j], rel=3e-4)
    moment = 0.5 - b / 6
    assert record.model_scale[0][3] * moment == pytest.approx(record.gamma[0], rel=2e-3)
    assert record.model_scale[1][3] * taylor[0, 1] == pytest.approx(record.gamma[1], rel=3e-4)


def test_covariance_settings_run_to_the_steady_gain(lqr, calibrated):
    """The scaled Riccati recursion in float64 ends at the constant gains of the same filter."""
    record, _ = calibrated
    one = 2.0**24
    phi = np.array(record.covariance_phi) / one
    output = np.array(record.covariance_output) / one
    process = np.diag(np.array(record.process_noise) / one)
    measurement = np.array(record.measurement_noise) / one
    covariance = np.diag(np.array(record.covariance_start) / one)
    gains = np.zeros((2, 5))
    for _ in range(3000):
        covariance = phi @ covariance @ phi.T + process
        for m in range(2):
            gains[m] = (
                covariance @ output[m] / (output[m] @ covariance @ output[m] + measurement[m])
            )
            covariance = covariance - np.outer(gains[m], output[m] @ covariance)
    q_state, q_measured = (30, 27, 24, 24, 27), (27, 24)
    expected = lqr.controller.observer.correction
    for m in range(2):
        for i in range(4):
            shift = record.covariance_gain_shift[m][i]
            physical = gains[m][i] * one * 2.0 ** -(shift + q_state[i] - q_measured[m])
            # only the variances of the process noise are kept, not its correlations
            assert physical == pytest.approx(expected[m, i], rel=0.5, abs=2e-3)


def test_file_comes_back_as_it_was(tmp_path, calibrated):
    record, tables = calibrated
    path = tmp_path / "sub" / "calibration.toml"
    calibration_file.save(path, record, tables)
    loaded = calibration_file.load(path)
    assert packed(loaded.record) == packed(record)
    assert loaded.record.crc == record.crc
    assert loaded.law == "lqr"
    assert loaded.vehicle == vehicles.load("van_real")
    assert loaded.verified
    assert calibration_file.dumps(loaded.record, loaded.tables) == path.read_text()
    assert tomllib.loads(path.read_text())["schema"] == 3
    assert loaded.delay_warning(0.01) == ""
    assert "expect a limit cycle" in loaded.delay_warning(10.0) or loaded.max_delay == np.inf


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema = 3", "schema = 2", r"schema 2, but this version reads 3"),
        ("tick_us = 10000", "tick_us = 50", r":\d+: 'tick_us' = 50 is outside 1000 to 20000"),
        ("tick_us = 10000", "tick_us = 9000", r":\d+: crc does not match"),
        ("tick_us = 10000", "tick_us = 1.5", r":\d+: 'tick_us' must hold integers, not 1.5"),
        ("tick_us = 10000", "tikc_us = 10000", r":\d+: unknown key 'tikc_us': did you mean"),
        ("crc = ", "budget_tick_us = 0\ncrc = ", r"'budget_tick_us': create it again"),
        ("tick_us = 10000\n", "", r"missing key 'tick_us'"),
        ("[margins]", "[marigns]", r"unknown key 'marigns'"),
        ("law = 0", "law = [0]", r"'law' must hold integers"),
        ("schema = 3", "schema = ", r"not a TOML file"),
        ("verified = true", "verified = false", r"digest does not match .* edited"),
        ("max_delay_s = 0", "max_delay_s = 1", r"digest does not match"),
        ("vehicle_sha256 = ", "vehicle = ", r"missing key 'vehicle_sha256'|not a TOML"),
        ("digest = ", "digset = ", r"unknown key 'digset': did you mean 'digest'"),
        ('law = "lqr"\n', "", r"\[design\] missing key 'law'"),
        ('law = "lqr"\n', "law = 5\n", r"\[design\] 'law' must be of type str"),
        ("tick_s = ", 'tick_s = "x" # ', r"\[design\] 'tick_s' must be of type int or float"),
        ("warnings = [", "warnings = 5\nothers = [", r"\[design\] 'warnings' must be of type list"),
        ("max_delay_s = ", "max_delay_s = [] # ", r"\[margins\] 'max_delay_s' must be of type int"),
    ],
)
def test_a_spoiled_file_is_refused_in_one_line(tmp_path, calibrated, old, new, message):
    text = calibration_file.dumps(*calibrated)
    assert old in text
    path = tmp_path / "calibration.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(CanrollError, match=message) as caught:
        calibration_file.load(path)
    assert "\n" not in str(caught.value)


def test_a_vehicle_of_other_numbers_than_designed_for_is_refused(tmp_path, calibrated):
    record, tables = calibrated
    heavier = {**tables["vehicle"], "plant": {**tables["vehicle"]["plant"], "sprung_mass": 2281.0}}
    path = tmp_path / "calibration.toml"
    calibration_file.save(path, record, {**tables, "vehicle": heavier})
    with pytest.raises(
        CanrollError, match=r"calibration\.toml:\d+: the fingerprint does not match"
    ):
        calibration_file.load(path)


@pytest.mark.parametrize("name", ["calibration", "design", "margins", "provenance", "vehicle"])
@pytest.mark.parametrize("value", [True, "law vehicle actuator verified tick_s warnings", [1]])
def test_a_table_that_is_none_is_refused(tmp_path, calibrated, name, value):
    content = tomllib.loads(calibration_file.dumps(*calibrated)) | {name: value}
    path = tmp_path / "calibration.toml"
    path.write_text(tomli_w.dumps(content))
    with pytest.raises(CanrollError, match=rf"{name} must be a table"):
        calibration_file.load(path)


def test_a_vehicle_file_is_named_as_one():
    path = Path(vehicles.__file__).with_name("van_real.toml")
    with pytest.raises(CanrollError, match=r"van_real\.toml: this is a vehicle, for --vehicle"):
        calibration_file.load(path)


def test_the_digest_leaves_out_the_time_of_the_solver(calibrated):
    record, tables = calibrated
    slower = {**tables, "design": {**tables["design"], "solve_s": 99.0}}
    other = {**tables, "design": {**tables["design"], "delay_s": 99.0}}
    first, second, third = (
        tomllib.loads(calibration_file.dumps(record, each))["digest"]
        for each in (tables, slower, other)
    )
    assert first == second != third


def test_a_budget_may_be_added_to_a_file(tmp_path, calibrated):
    path = tmp_path / "calibration.toml"
    path.write_text(calibration_file.dumps(*calibrated) + "\n[budget]\ninstructions = 20000\n")
    assert calibration_file.load(path).tables["budget"] == {"instructions": 20000}


def test_unreadable_and_unwritable_files(tmp_path, calibrated):
    with pytest.raises(CanrollError, match="cannot read calibration"):
        calibration_file.load(tmp_path / "none.toml")
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(CanrollError, match="cannot write"):
        calibration_file.save(blocker / "calibration.toml", *calibrated)


def test_crc_covers_every_field(calibrated):
    record, _ = calibrated
    values = {field.name: getattr(record, field.name) for field in fields(Calibration)}
    for field in fields(Calibration):
        if field.name == "crc":
            continue
        changed = fill(values)
        value = getattr(changed, field.name)
        first = next(iter(flatten(value)))
        moved = first + 1 if first < field.f.hi else first - 1
        if isinstance(value, list) and isinstance(value[0], list):
            value[0][0] = moved
        elif isinstance(value, list):
            value[0] = moved
        else:
            setattr(changed, field.name, moved)
        assert sealed(changed).crc != record.crc, field.name
    assert identify(fill(values)).id == record.id


def test_header_compiles_alone_and_holds_the_same_integers(tmp_path, lqr, calibrated):
    record, _ = calibrated
    text = gains_header(record, title=title(lqr), physical=physical_notes(record))
    header = tmp_path / "canroll_gains.h"
    header.write_text(text)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"]
    subprocess.run(["gcc", *strict, "-fsyntax-only", str(header)], check=True)
    program = tmp_path / "dump.c"
    lines = ['#include "canroll_gains.h"', "#include <stdio.h>"]
    lines += ["static const canroll_calibration g = CANROLL_CALIBRATION_INITIALISER;"]
    lines += ["int main(void) {"]
    for field in fields(Calibration):
        kind = "uint8_t" if field.kind == "u8" else "int32_t"
        count = int(np.prod(field.shape)) if field.shape else 1
        lines += [
            f"    {{ const {kind} *p = (const {kind} *)&g.{field.name};",
            f'      for (int i = 0; i < {count}; i++) printf("%ld\\n", (long)p[i]); }}',
        ]
    lines += ["    return 0;", "}"]
    program.write_text("\n".join(lines))
    binary = tmp_path / "dump"
    subprocess.run(["gcc", "-std=c99", str(program), "-o", str(binary)], check=True)
    printed = subprocess.run([str(binary)], check=True, capture_output=True, text=True).stdout
    expected = [v for f in fields(Calibration) for v in flatten(getattr(record, f.name))]
    assert [int(line) for line in printed.split()] == expected


def test_header_comments_cannot_end_early():
    assert plain("a */ b /* c \\ d") == "a * / b / * c / d"
    text = gains_header(Calibration(), title=["law */\nint x;"])
    assert " * law * / int x;\n" in text


def test_limits_follow_the_actuators():
    van = task()
    share = van.vehicle.geometry.static_front_share
    limit = moment_limit(van, share)
    geometry = van.vehicle.geometry
    front = limit * share / (2 * geometry.half_track_front)
    rear = limit * (1 - share) / (2 * geometry.half_track_rear)
    assert max(front, rear) == pytest.approx(van.vehicle.actuators.suspension.force_limit)
    bars = moment_limit(replace(van, actuator="bars"), share)
    assert bars * max(share, 1 - share) == pytest.approx(van.vehicle.actuators.bars.torque_limit)


def test_damper_knee_is_where_the_curve_bends():
    dampers = load("van_real").actuators.dampers
    assert damper_knee(dampers, dampers.firm_force)[:2] == pytest.approx((0.15, 3300.0))
    assert damper_knee(dampers, dampers.soft_force)[:2] == pytest.approx((0.3, 1200.0))


def test_unknown_names_and_impossible_numbers():
    with pytest.raises(UnknownNameError, match="did you mean 'lqg_delay'"):
        design("lqg_dely", task())
    with pytest.raises(UnknownNameError, match="observer"):
        design("lqr", task(observer="three_sensors"))
    with pytest.raises(CanrollError, match="tick"):
        design("lqr", task(tick=0.05))
    with pytest.raises(VerdictError, match="no roll-rate gain helps"):
        design("hinf_delay", replace(task(), delay=Delay(0.02, 0.02, 0.6)))


def test_custom_gains(tmp_path):
    path = tmp_path / "gains.toml"
    path.write_text("K = [[14400.0, 6000.0]]\nKff = 120.0\n")
    answer = design("custom", task(matrices=str(path)))
    np.testing.assert_allclose(answer.controller.feedback[:2], [14400.0, 6000.0])
    stored = tmp_path / "compensator.npz"
    a, b = np.diag([0.9, 0.5]), np.array([[1e-3, 2.0, 0, 0], [0, 0.1, 0.2, 0]])
    c, d = np.array([[-400.0, -60.0]]), np.array([[0.0, -4000.0, -20.0, 0.0]])
    np.savez(stored, A=a, B=b, C=c, D=d)
    answer = design("custom", task(matrices=str(stored)))
    record, tables = calibrate(answer)
    assert record.law == 2
    assert record.compensator_order == 2
    assert tables["verification"]["quantised_moment_nm"]["ok"]
    # scaling the states must not change what the compensator does
    scaled = answer.controller.compensator
    z = np.exp(0.3j)
    before = c @ np.linalg.solve(z * np.eye(2) - a, b) + d
    after = scaled.c @ np.linalg.solve(z * np.eye(2) - scaled.a, scaled.b) + scaled.d
    np.testing.assert_allclose(after, before, rtol=1e-9)


def first_order(a):
    return f"A = [[{a}]]\nB = [[1.0, 0, 0, 0]]\nC = [[1.0]]\nD = [[0, 0, 0, 0]]"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gains.csv", "1", "give a .npz, .mat or .toml"),
        ("gains.toml", "K = [[1.0, 2.0, 3.0]]", "K has 3 entries"),
        ("gains.toml", "L = [[1.0]]", "unknown matrix 'L'"),
        ("gains.toml", "K = [[nan, 1.0]]", "K has a number that is not finite"),
        ("gains.toml", "A = [[0.5]]\nB = [[1.0, 0, 0, 0]]\nC = [[1.0]]", "D is missing"),
        ("gains.toml", "A = [[0.5]]\nB = [[1.0]]\nC = [[1.0]]\nD = [[0, 0, 0, 0]]", "B is"),
        ("gains.npz", "not a zip", "cannot read matrices"),
        ("gains.toml", "K = [[1.0, 2.0]]\nA = [[0.5]]", "K is of a state feedback, A of a comp"),
        ("gains.toml", "Kff = 3.0\nD = [[0, 0, 0, 0]]", "Kff is of a state feedback, D of a comp"),
        ("gains.toml", first_order("1.2"), "A has an eigenvalue outside the unit circle: 1.2"),
        (
            "gains.toml",
            f"{first_order('0.9')}\nE = [[-2.0]]",
            r"A \+ E C has an eigenvalue outside the unit circle: -1.1",
        ),
    ],
)
def test_custom_files_that_do_not_fit(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(CanrollError, match=message):
        design("custom", task(matrices=str(path)))
    with pytest.raises(CanrollError, match="add --matrices FILE"):
        design("custom", task())


def test_margins_of_the_integers_are_those_of_the_design(tmp_path, lqr, calibrated):
    path = tmp_path / "calibration.toml"
    calibration_file.save(path, *calibrated)
    report = margin_report(calibration_file.load(path))
    at_design = next(p for p in report.over_delay if p.delay == lqr.task.delay.nominal)
    assert at_design.margins.gain_db == pytest.approx(lqr.margins["gain_db"], rel=1e-3)
    assert at_design.peak < 1.0
    assert report.family.worst_gain.margins.gain_db == pytest.approx(
        lqr.verified["gain_margin_db"].value, rel=1e-3
    )
    assert all(check.ok for check in report.checks.values())
    assert report.max_delay == pytest.approx(lqr.max_delay, abs=3e-4)
    nothing = report.over_gain[0]
    assert nothing.peak == pytest.approx(1.0, rel=1e-6)


def test_summary_is_plain_json(lqr):
    text = json.dumps(summary(lqr), allow_nan=False)
    assert set(json.loads(text)) >= {
        "law", "vehicle", "delay_s", "tick_s", "gain", "gamma", "gamma_bound", "max_delay_s",
        "rightmost_root", "margins", "verified", "solve_s",
    }  # fmt: skip


@pytest.mark.slow
def test_a_level_names_its_channel_and_no_column_compares_levels(monkeypatch, capsys):
    """The level of the one is in weighted degrees, that of the other in rad per SI disturbance."""
    laws = ("hinf", "rate_feedforward", "plain_feedforward")
    monkeypatch.setattr("canroll.cli.design_comparison.LAWS", laws)
    arguments = ["design", "--compare", "--vehicle", "van_2021", "--delay", "100"]
    assert main([*arguments, "--json"]) == 0
    hinf, rate, plain = json.loads(capsys.readouterr().out)
    assert "weighted degrees" in hinf["gamma_channel"]
    assert "roll + roll rate" in rate["gamma_channel"]
    assert plain["gamma"] is None
    assert plain["gamma_channel"] is None
    assert main(arguments) == 0
    heading, *rows = capsys.readouterr().out.splitlines()[1:]
    assert "gamma" not in heading
    assert [row.split()[0] for row in rows] == list(laws)
    assert {len(row) for row in rows} == {len(heading)}


@pytest.mark.slow
def test_command_line_writes_and_reads(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["design", "--law", "hinf_delay", "--vehicle", "van_2021", "--delay", "100"]
    theorem = ["--gains", "theorem", "--unverified"]
    assert main([*arguments, *theorem, "--json", "--out", str(out)]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["gain"][0][0] == pytest.approx(-2871.0, rel=0.05)
    assert answer["max_delay_s"] is None
    failed = {name for name, check in answer["verified"].items() if not check["ok"]}
    assert failed == {"gain_margin_db", "peak_sensitivity"}
    assert "empty" in answer["verified"]["gain_margin_db"]["where"]
    assert answer["verified"]["quantised_moment_nm"]["value"] < 0.1
    assert answer["margins"]["exact_best_gain"] == pytest.approx(-2624.0, rel=0.03)
    assert (out / "canroll_gains.h").is_file()
    path = out / "calibration.toml"
    assert main(["margins", str(path), "--out", str(out)]) == 1
    shown = capsys.readouterr().out
    assert "stable for any delay" in shown
    assert "laden, 80 km/h, curve of 6 m/s²" in shown
    assert (out / "margins.png").stat().st_size > 10_000
    assert main(["margins", str(path), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["law"] == "hinf_delay"
    assert len(found["family"]) == 10


def test_command_line_says_what_is_wrong(tmp_path, capsys):
    out = ["--out", str(tmp_path)]
    words = ["design", "--law", "hinf_nodelay", "--gains", "as_printed", *out]
    assert main(words) == 1
    assert not list(tmp_path.iterdir())
    capsys.readouterr()
    assert main([*words, "--unverified"]) == 1
    printed = capsys.readouterr()
    assert "NOT VERIFIED" in printed.out
    assert not calibration_file.load(tmp_path / "calibration.toml").verified
    assert "NOT VERIFIED" in (tmp_path / "canroll_gains.h").read_text()
    (tmp_path / "empty.toml").write_text("")
    for arguments, code, message in (
        (["design", "--delay", "-3"], 2, "must not be negative"),
        (["design", "--delay", "20", "--bus", "500k"], 2, "the bus has its delay"),
        (["margins", str(tmp_path / "none")], 2, "cannot read calibration"),
        (["margins", str(tmp_path / "empty.toml")], 2, "empty file"),
        (["design", "--vehicle", str(tmp_path / "empty.toml")], 2, "empty file"),
        (["design", "--gamma", "1.4"], 2, "omit it"),
        (["design", "--law", "hinf_delay", "--gamma", "-1"], 2, "must be positive"),
        (["design", "--gains", "as_printed"], 2, "steering_lead has none"),
        (["design", "--law", "custom", "--matrices", str(tmp_path)], 2, "it is a directory"),
    ):
        assert main([*arguments, *(out if arguments[0] == "design" else [])]) == code
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1


def test_printed_gains_that_fail_are_marked_and_every_number_has_its_unit(tmp_path, capsys):
    words = ["--vehicle", "suv_2020", "--law", "lqr", "--gains", "as_printed", "--unverified"]
    code = main(["design", *words, "--out", str(tmp_path)])
    shown = capsys.readouterr().out
    assert code == int(" FAILS" in shown)
    assert not calibration_file.load(tmp_path / "calibration.toml").verified
    assert "warning: NOT VERIFIED: lqr with the gains as printed" in shown
    assert main(["design", "--law", "hinf_delay", "--verbose", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert " dB" in shown
    assert re.search("ok +empty, 80 km/h", shown)
    assert "margin over the longest delay" in shown and "largest delay, sampled loop" in shown
    assert " inf" not in shown


def test_every_law_has_a_line_of_documentation():
    assert all((function.__doc__ or "").strip() for function in LAWS.values())
