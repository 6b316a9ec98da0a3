"""The commands: export-c refuses what is not verified, timing judges the budget."""

import json
from pathlib import Path

import pytest

from canroll.cli import export_c, prove, timing
from canroll.cli.main import main, parse
from canroll.codegen.run import cortex, native
from canroll.errors import CanrollError, VerdictError

pytestmark = [
    pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler"),
    pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]"),
]


@pytest.mark.slow
def test_an_unverified_design_needs_the_word(tmp_path, monkeypatch):
    args = parse(["export-c", str(tmp_path / "out")])
    plan = export_c.plan

    def doubtful(*names, **options):
        settings, controller = plan(*names, **options)
        controller.tables["design"]["verified"] = False
        return settings, controller

    monkeypatch.setattr(export_c, "plan", doubtful)
    with pytest.raises(VerdictError, match="--unverified"):
        export_c.run(args)
    assert not (tmp_path / "out").exists()
    assert export_c.run(parse(["export-c", str(tmp_path / "out"), "--unverified"])) == 0
    assert "NOT VERIFIED" in (tmp_path / "out" / "README.md").read_text()
    assert "NOT VERIFIED" in (tmp_path / "out" / "include" / "canroll_gains.h").read_text()


def test_timing_counts_a_replayed_manoeuvre(capsys):
    words = ("timing", "--duration", "0.5", "--counter", "unicorn", "--processor", "cortex-m4")
    assert timing.run(parse(words)) == 0
    out = capsys.readouterr().out
    assert "unicorn, instructions (not cycles)" in out
    assert "PASS" in out


@pytest.mark.parametrize("words", [("file",), ("file/below",), ("/proc/x",)])
def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, words):
    (tmp_path / "file").write_text("")
    args = parse(["export-c", str(tmp_path / words[0])])
    with pytest.raises(CanrollError, match=r"^cannot write to ") as caught:
        export_c.run(args)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "file").read_text() == ""


@pytest.mark.slow
def test_the_proof_as_json(capsys):
    assert prove.run(parse(["prove", "--json"])) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["proved"] is True
    assert answer["findings"] == []
    assert answer["expressions"] > 1000


@pytest.mark.slow
def test_the_bound_of_a_tick_is_printed_beside_the_most_seen(capsys):
    if not cortex.has_gcc_and_qemu():
        pytest.skip("needs gcc-arm-none-eabi and qemu-system-arm")
    words = ("timing", "--bound", "--law", "lqr", "--clock", "24", "--processor", "cortex-m0")
    assert timing.run(parse((*words, "--duration", "1", "--ticks", "600", "--json"))) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["verdict"] == "PASS"
    assert answer["ticks"] >= 600
    assert answer["late_ticks"] > 20
    assert answer["cycles"]["seen"] <= answer["cycles"]["bound"] <= 1.5 * answer["cycles"]["seen"]
    assert answer["stack"]["seen"] <= answer["stack"]["bound"]
    assert answer["share_of_tick"] == pytest.approx(answer["cycles"]["bound"] / 240_000)
    assert sum(answer["functions"].values()) == answer["cycles"]["bound"]


@pytest.mark.long
def test_the_bound_on_a_bus_with_authenticated_frames_says_how_many_a_tick_sees(capsys):
    if not cortex.has_gcc_and_qemu():
        pytest.skip("needs gcc-arm-none-eabi and qemu-system-arm")
    words = ["timing", "--bound", "--bus", "secured_fd", "--law", "lqr", "--specialise"]
    words += ["--duration", "1", "--ticks", "300"]
    assert timing.run(parse([*words, "--json"])) == 0
    answer = json.loads(capsys.readouterr().out)
    its = answer["authentication"]
    assert (its["received"], its["sent"]) == (72, 3)
    assert its["cycles"] > 72 * its["verify"] + 3 * its["protect"]
    assert its["cycles"] < answer["cycles"]["bound"] == sum(answer["functions"].values())
    assert answer["cycles"]["seen"] <= answer["cycles"]["bound"] <= 1.1 * answer["cycles"]["seen"]
    assert timing.run(parse(words)) == 0
    out = capsys.readouterr().out
    assert "frames received, bus full" in out
    assert f"of these for authentication        {its['cycles']}\n" in out


@pytest.mark.slow
def test_qemu_counts_authentication_too(capsys):
    if not cortex.has_gcc_and_qemu():
        pytest.skip("needs gcc-arm-none-eabi and qemu-system-arm")
    words = ("timing", "--bus", "secured_fd", "--law", "lqr", "--duration", "0.3", "--json")
    assert timing.run(parse([*words, "--counter", "qemu"])) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["counter"] == "qemu"
    assert 1000 < answer["authentication_instructions"]["mean"] < answer["instructions"]["mean"]


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (("--ticks", "0"), "--ticks must be at least 1"),
        (("--clock", "-3"), "--clock must be positive"),
        (("--wait-states", "99"), "--wait-states must be 0 to 15"),
        (("--multiplier", "7"), "--multiplier must be 1 or 32"),
        (("--division", "40"), "--division must be 2 to 12"),
    ],
)
def test_a_bound_for_a_circuit_that_cannot_be_is_refused(option, message):
    with pytest.raises(CanrollError, match=message):
        timing.run(parse(("timing", "--bound", *option)))


@pytest.mark.slow
def test_timing_of_specialised_firmware_takes_fewer_instructions(capsys):
    means = []
    for options in ([], ["--specialise"]):
        args = parse(["timing", "--law", "lqr", "--duration", "0.3", "--json", *options])
        assert timing.run(args) == 0
        means.append(json.loads(capsys.readouterr().out)["instructions"]["mean"])
    assert means[1] < 0.7 * means[0]


@pytest.mark.long
def test_timing_of_specialised_firmware_counts_the_same_authentication(capsys):
    answers = []
    for options in ([], ["--specialise"]):
        words = ("timing", "--bus", "secured_fd", "--law", "lqr", "--duration", "0.3", "--json")
        args = parse([*words, "--counter", "unicorn", *options])
        assert timing.run(args) == 0
        answers.append(json.loads(capsys.readouterr().out))
    general, special = answers
    assert special["authentication_instructions"] == general["authentication_instructions"]
    assert special["instructions"]["mean"] < 0.8 * general["instructions"]["mean"]
    assert special["bytes"]["state"] == general["bytes"]["state"]


OWN = Path(__file__).parents[3] / "examples" / "own_bus"
COMMANDS_OF_OWN = (
    "export-c {folder}/c --law lqr --actuator dampers {frames}",
    "ecu --calibration {folder}/calibration.toml --replay {folder}/log.asc {frames}",
    "ecu --calibration {folder}/calibration.toml -i virtual -c none --duration 1 {frames}",
)


@pytest.mark.parametrize("command", COMMANDS_OF_OWN, ids=lambda words: " ".join(words.split()[:4]))
def test_frames_over_which_nothing_is_commanded_are_refused(command, tmp_path, capsys):
    assert main(["design", "--law", "lqr", "--actuator", "dampers", "--out", str(tmp_path)]) == 0
    (tmp_path / "log.asc").write_text("")
    frames = f"--dbc {OWN / 'own.dbc'} --map {OWN / 'own.toml'}"
    capsys.readouterr()
    assert main(command.format(folder=tmp_path, frames=frames).split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "own.toml: no [transmit.damper], which commands" in error
