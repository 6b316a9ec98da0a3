"""An option that would have no effect is refused in one line, before anything slow is done."""

import pytest

from canroll.cli.commands import COMMANDS, parser_of
from canroll.cli.main import main, parse
from canroll.cli.parser import refuse
from canroll.errors import CanrollError

USELESS = [
    ("run moose --plant linear_car --set friction=0.8", "friction: linear_car has no tyres"),
    ("timing --ticks 9", "--ticks: it belongs to --bound"),
    ("timing --clock 80", "--clock: it belongs to --bound"),
    ("timing --wait-states 2", "--wait-states: it belongs to --bound"),
    ("timing --multiplier 32", "--multiplier: it belongs to --bound"),
    ("timing --division 3", "--division: it belongs to --bound"),
    ("timing --bound --counter qemu", "--counter: --bound reads the code"),
    ("timing --hil --counter unicorn", "--counter: --hil runs on this machine"),
    ("timing --hil --processor cortex-m0", "--processor: --hil runs on this machine"),
    ("timing --hil --processor cortex-m4", "--processor: --hil runs on this machine"),
    ("timing --hil --ticks=4000", "--ticks: --hil runs on this machine"),
    ("timing --hil --specialise", "--specialise: --hil runs on this machine"),
    ("timing --hil --bound", "--bound: --hil runs on this machine"),
    ("timing --hil --clock 80", "--clock: --hil runs on this machine"),
    ("ecu --pace lockstep --cpu 0", "--cpu: in lock step no core is chosen"),
    ("ecu --replay t.npz --calibration c.toml", "--calibration: a trace is replayed as it was"),
    ("ecu --replay t.npz --duration 3", "--duration: a trace is replayed as it was"),
    ("ecu --replay t.npz --pace lockstep", "--pace: a trace is replayed as it was"),
    ("ecu --replay t.npz --trace u.npz", "--trace: a trace is replayed as it was"),
    ("ecu --replay t.npz --peer-timeout 3", "--peer-timeout: a trace is replayed as it was"),
    ("ecu --replay t.npz --phase 2", "--phase: a trace is replayed as it was"),
    ("ecu --replay t.npz -i virtual", "--interface: a trace is replayed as it was"),
    ("ecu --replay t.npz -c x", "--channel: a trace is replayed as it was"),
    ("plant moose --pace lockstep --cpu 0", "--cpu: in lock step no core is chosen"),
    ("plant moose --serve 127.0.0.1:1 -i virtual -c x", "--serve: it is of the plant's own bus"),
    ("plant moose -c vcan0", "--channel is of an interface: add -i"),
    ("plant moose -b 500000", "--bitrate is of an interface: add -i"),
    ("hil moose -c vcan0", "--channel is of an interface: add -i"),
    ("hil moose --fd", "--fd is of an interface: add -i"),
    ("run moose --law passive --observer one_sensor", "--observer: --law passive has no control"),
    ("run moose --law passive --no-feedforward", "--no-feedforward: --law passive has no control"),
    ("run moose --law passive --identification", "--identification: --law passive has no"),
    ("run moose --law passive --no-watch-response", "--no-watch-response: --law passive has"),
    (
        "run moose --actuator dampers --no-watch-response",
        "--no-watch-response: the commands of dampers",
    ),
    (
        "run moose --observer reference --law lqr --no-watch-response",
        "--no-watch-response: observer reference",
    ),
    ("run moose --law passive --gains as_printed", "--gains: --law passive has no control"),
    ("hil moose --gains as_printed", "--gains: canroll hil does not take it: write it into canr"),
    ("export-c out --trigger every", "or use a --calibration that has it"),
    ("compare lqr --key k", "--key: canroll compare does not take it: write it into canroll.toml"),
    ("run moose --trigger every --heartbeat 30", "--heartbeat: with --trigger every a command is"),
    ("run moose --actuator dampers --heartbeat 30", "--heartbeat: to dampers a command is sent"),
    (
        "run moose --actuator dampers --condition oil_temperature=0",
        "actuators: oil_temperature does not act on dampers",
    ),
    ("run moose --law hinf_delay --no-feedforward", "--no-feedforward: hinf_delay has none"),
    ("run moose --law plain_feedforward --no-feedforward", "plain_feedforward is nothing else"),
    ("design --law ay_feedforward --no-feedforward", "ay_feedforward is nothing else"),
    ("design --law lqr_full_car --no-feedforward", "--no-feedforward: lqr_full_car has none"),
    ("run moose --law custom", "--law custom needs its gains: add --matrices FILE"),
    ("compare law=custom lqr", "--law custom needs its gains: add --matrices FILE"),
    ("design --law lqr --matrices k.toml", "--matrices applies to --law custom only"),
    ("run moose --set friction=0.8 --set friction=0.4", "--set friction: given twice"),
    ("compare law=lqr,speed=80 --speed 60:80:20", "law=lqr,speed=80: it has its speed: omit it"),
    ("compare --effort 900", "--effort: it belongs to --runs"),
    ("compare lqr smc --spread speed=0.1", "--spread: it belongs to --runs"),
    ("compare lqr smc --resume", "--resume: it belongs to --runs"),
    ("compare lqr --runs 2", "lqr: --runs drives laws of its own"),
    ("compare --runs 2 --law lqr", "--law: --runs drives every law"),
    ("compare --runs 2 --seed 3", "--seed: --runs drives every law"),
    ("compare --runs 2 --effort -4", "--effort -4: must be 1 to 20000"),
    ("compare --runs 1", "--runs must be at least 2"),
    ("compare --scenario severe --runs 3 --effort 900", "--effort: the severe manoeuvres are"),
    ("compare --scenario severe --speed 80", "--speed: it does not apply to several manoeuvres"),
    ("compare --scenario severe --seed 3", "--seed: it does not apply to several manoeuvres"),
    ("sweep --law lqr", "'sweep' is now 'canroll compare --speed FROM:TO:STEP'"),
    ("faults --attack flood", "--attack: it belongs to --catalogue attacks"),
    ("faults --catalogue attacks --all", "--all: --catalogue attacks lists every attack"),
    ("list laws --shell zsh", "--shell: it belongs to canroll list completion"),
    ("list completion --json", "--json: a script is no list"),
    ("run . --law lqr", "--law: a saved run is evaluated as it was driven"),
    ("run . --log bus.asc", "--log: a saved run is evaluated as it was driven"),
    ("report out", "'report' is now 'canroll run FOLDER'"),
    ("understeer --law lqr", "'understeer' is now 'canroll handling circle'"),
    ("watch", "-i and -c are required to select the bus"),
    ("watch -c vcan0", "-i and -c are required to select the bus"),
    ("hil moose -c vcan0", "--channel is of an interface: add -i"),
    ("campaign --event rollover", "--event: it belongs to --until"),
    ("compare --runs 9 --only 3 --resume", "--resume: --only drives one case"),
    ("faults --resume", "--resume needs the folder to continue in: add --out"),
    ("design --compare --runs 2", "'design --runs' is now 'canroll compare --runs N'"),
    ("campaign --only 3 --resume", "--resume: --only drives one case"),
    ("campaign --only 3 --until 0.1", "--until: --only drives one case"),
    ("campaign --only 3 --scheduler tcp://x:1", "--scheduler: --only drives one case"),
    ("bus examples/bus.toml --host 0.0.0.0", "--host: it belongs to --serve"),
    ("bus examples/bus.toml --serve --offsets", "--offsets: a served bus is not analysed"),
    ("bus examples/bus.toml --serve --json", "--json: a served bus is not analysed"),
    ("bus examples/bus.toml --serve --sensor Imi", "--sensor: a served bus is not analysed"),
    ("bus examples/bus.toml --serve --tick 10", "--tick: a served bus is not analysed"),
    ("bus examples/bus.toml --serve --simulate 3", "--simulate: a served bus is not analysed"),
]


@pytest.mark.parametrize(("line", "says"), USELESS, ids=[line for line, _ in USELESS])
def test_an_option_without_effect_is_refused(line, says, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    told = capsys.readouterr().err
    assert says in told
    assert len(told.splitlines()) == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_what_is_not_given_is_no_fault():
    args = parse(["timing", "--duration", "3"])
    assert args.given == {"duration"} and args.ticks == 4000
    refuse(args, "ticks", "it has no effect")


def test_an_option_is_given_by_its_word_not_by_its_value():
    with pytest.raises(CanrollError, match="--duration: it has no effect: omit it"):
        refuse(parse(["timing", "--duration", "5"]), "duration", "it has no effect")


def test_every_relation_names_options_of_its_command():
    for name in COMMANDS:
        parser = parser_of(name)
        known = {action.dest for action in parser._actions}
        for option, relations in parser.relations.items():
            others = [*relations.needs, *relations.excludes]
            # the choices' relations name the law, which not all commands have
            assert {each.partition("=")[0] for each in others} <= {*known, "law"}, option
            assert option in known
