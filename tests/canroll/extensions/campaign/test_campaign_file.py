"""Campaign files: every key is checked, and what is drawn follows the distributions."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest, lognorm, norm, spearmanr, truncnorm
from support import split_bus

from canroll import vehicles
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.extensions.campaign import distributions, quantities
from canroll.extensions.campaign.campaign_file import KEYS, TABLES, load, of_options
from canroll.extensions.campaign.space import Correlation, Sampling, Space
from canroll.plant_sim.bodies.parameters import build_parameters

WHOLE = """
schema = 1
scenario = "roundabout"
runs = 512
seed = 3
sampling = "{sampling}"
chunk = 64
[run]
law = "lqr"
plant = "roll1"
[draw]
vehicle.sprung_mass = {{normal = [1, 0.1], within = [0.7, 1.3]}}
vehicle.cg_height_above_roll_axis = {{uniform = [0.9, 1.1]}}
vehicle.tyre.relaxation_length = {{lognormal = [1, 0.2]}}
speed_kmh = {{uniform = [50, 70]}}
phase_ms = {{uniform = [0, 9]}}
bus = {{values = ["500k", "gateway_20ms"], weights = [3, 1]}}
option.friction = {{uniform = [0.7, 1.0]}}
condition.noise = {{uniform = [0, 2]}}
[faults]
of = ["Imu.RollRate=stuck@1", "front_left=weak:0.3", "rear_left=stuck@2"]
single = 0.3
double = 0.15
[[correlation]]
of = ["vehicle.sprung_mass", "vehicle.cg_height_above_roll_axis"]
rank = 0.6
"""


def written(tmp_path, text):
    path = tmp_path / "c.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_everything_is_drawn_as_written(tmp_path, sampling):
    path = written(tmp_path, WHOLE.format(sampling=sampling))
    plan = load(path, {}, runs=None, seed=None).plan()
    parts = [plan.draws(chunk) for chunk in range(plan.chunks)]
    columns = {name: np.concatenate([part[name] for part, _ in parts]) for name in parts[0][0]}
    settings = [each for _, part in parts for each in part]
    assert len(settings) == 512
    mass, height = columns["vehicle.sprung_mass"], columns["vehicle.cg_height_above_roll_axis"]
    assert kstest(mass, truncnorm(-3, 3, 1, 0.1).cdf).pvalue > 0.01
    assert spearmanr(mass, height).statistic == pytest.approx(0.6, abs=0.06)
    assert np.mean(columns["bus"] == "500k") == pytest.approx(0.75, abs=0.05)
    pairs = [fault.count("; ") + 1 if fault else 0 for fault in columns["faults"]]
    assert np.bincount(pairs) / 512 == pytest.approx([0.55, 0.30, 0.15], abs=0.06)
    nominal = plan.settings.vehicle
    for row, drawn in enumerate(settings):
        assert drawn.speed == columns["speed_kmh"][row] / 3.6
        assert drawn.phase == 1e-3 * columns["phase_ms"][row]
        assert dict(drawn.options)["friction"] == columns["option.friction"][row]
        assert dict(drawn.conditions)["noise"] == columns["condition.noise"][row]
        assert drawn.vehicle.plant.sprung_mass == nominal.plant.sprung_mass * mass[row]
        length = columns["vehicle.tyre.relaxation_length"][row]
        assert drawn.vehicle.tyre.relaxation_length == nominal.tyre.relaxation_length * length
    assert plan.draw(200) == settings[200]


def test_distributions_have_their_quantiles():
    unit = np.array([0.01, 0.3, 0.5, 0.9])
    for text, reference in (
        ({"normal": [2, 0.5]}, norm(2, 0.5)),
        ({"lognormal": [2, 0.5]}, lognorm(0.5, scale=2)),
        ({"normal": [0, 1], "within": [-1, 3]}, truncnorm(-1, 3)),
    ):
        found = distributions.read(text, "x").quantile(unit)
        assert found == pytest.approx(reference.ppf(unit), rel=1e-9)
    assert list(distributions.read({"values": ["a", "b"], "weights": [1, 3]}, "x").quantile(unit))


def test_a_latin_hypercube_has_one_draw_in_each_layer():
    points = Sampling("latin_hypercube", 0, 32).points(5, 4)
    for column in points.T:
        assert sorted(np.floor(32 * column)) == list(range(32))


def test_a_sobol_sequence_goes_on_from_chunk_to_chunk():
    whole = Sampling("sobol", 4, 64).points(0, 3)
    parts = [Sampling("sobol", 4, 16).points(number, 3) for number in range(4)]
    assert np.array_equal(whole, np.concatenate(parts))


def test_correlation_leaves_the_distributions_alone():
    one = distributions.read({"uniform": [0, 1]}, "x")
    space = Space(("a", "b"), (one, one), (Correlation("a", "b", -0.7),))
    draws = [space.values(point) for point in np.random.default_rng(0).random((2000, 2))]
    first, second = ([draw[name] for draw in draws] for name in "ab")
    assert kstest(second, "uniform").pvalue > 0.01
    assert spearmanr(first, second).statistic == pytest.approx(-0.7, abs=0.03)


HEAD = 'schema = 1\nscenario = "roundabout"\nruns = 8\n[run]\nlaw = "lqr"\nplant = "roll1"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema = 2", "needs schema = 1"),
        ("schema = ", "not a campaign file"),
        ('schema = 1\nscenario = "roundabut"', "did you mean 'roundabout'?"),
        ('schema = 1\nscenario = "roundabout"', "runs must be a whole number, got None"),
        ('schema = 1\nscenario = "roundabout"\nruns = 0', "runs must be at least 1, got 0"),
        ('schema = 1\nscenario = "roundabout"\nrun = 8', "run must be a table"),
        ('schema = 1\nscenarios = "roundabout"', "did you mean 'scenario'?"),
        ('schema = 1\nscenario = "roundabout"\nsampling = "sobl"', "did you mean 'sobol'?"),
        (
            'schema = 1\nscenario = "roundabout"\nruns = 9\nsampling = "sobol"\nchunk = 3',
            "must be a power of two",
        ),
        (HEAD + "speed_km = 3", "did you mean 'speed_kmh'?"),
        (HEAD + 'speed_kmh = "fast"', "[run] speed_kmh: speed_kmh='fast': must be a number"),
        (HEAD + "speed_kmh = nan", "must be finite"),
        (HEAD + "feedforward = 1", "feedforward=1: must be True or False"),
        (HEAD + "seed = 1", "unknown key of"),
        (HEAD + "[draw]\nfrictoin = {uniform = [0, 1]}", "unknown quantity of"),
        (HEAD + "[draw]\nvehicle.mass = {uniform = [1, 2]}", "[draw] vehicle.mass"),
        (HEAD + "[draw]\nvehicle.name = {uniform = [1, 2]}", "[draw] vehicle.name"),
        (HEAD + "[draw]\nvehicle.sprung_mass = 3", "is not a distribution"),
        (HEAD + "[draw]\nvehicle.sprung_mass = {unifrm = [1, 2]}", "did you mean 'uniform'?"),
        (HEAD + "[draw]\nspeed_kmh = {uniform = [2, 1]}", "speed_kmh.uniform: 2 must be below 1"),
        (HEAD + "[draw]\nspeed_kmh = {uniform = [2, inf]}", "must be two finite numbers"),
        (HEAD + "[draw]\nspeed_kmh = {normal = [60, 20]}", "within = [LEAST, MOST]"),
        (HEAD + "[draw]\nspeed_kmh = {normal = [60, 0]}", "must be positive"),
        (HEAD + "[draw]\nspeed_kmh = {normal = [6, 1], within = [90, 91]}", "holds none of"),
        (HEAD + '[draw]\nspeed_kmh = {values = ["fast"]}', "must be a number"),
        (HEAD + "[draw]\nbus = {values = [500]}", "must be text"),
        (HEAD + '[draw]\nbus = {values = ["500"]}', "did you mean '500k'?"),
        (HEAD + '[draw]\nbus = {values = ["500k"], weights = [0]}', "nor all zero"),
        (HEAD + "[draw]\noption.frict = {uniform = [0, 1]}", "did you mean 'friction'?"),
        (
            HEAD + "[draw]\noption.friction = {uniform = [0, 1]}",
            "option friction of roundabout: 1e-12 must be 0.05 to 1.5",
        ),
        (HEAD + "[draw]\ncondition.nose = {uniform = [0, 1]}", "did you mean 'noise'?"),
        (HEAD + "[draw]\nphase_ms = {uniform = [0, 100]}", "must be 0 to 10 ms"),
        (HEAD + '[faults]\nof = ["Imu.RollRate=stick"]\nsingle = 0.1', "did you mean 'stuck'?"),
        (HEAD + "[faults]\nof = []", "must be a list of faults"),
        (HEAD + '[faults]\nof = ["Imu.RollRate=stuck"]\nsingle = 2', "must be a probability"),
        (HEAD + '[faults]\nof = ["Imu.RollRate=stuck"]\ndouble = 0.1', "needs two faults"),
        (HEAD + '[[correlation]]\nof = ["a", "b"]\nrank = 0.1', "unknown quantity of"),
        (HEAD + '[[correlation]]\nof = ["a", "b"]\nrank = 1', "above -1 and below 1"),
        (HEAD + '[[correlation]]\nof = "a"\nrank = 0.1', "must be the names of two"),
    ],
)
def test_what_cannot_be_names_file_and_key(tmp_path, capsys, text, message):
    path = written(tmp_path, text)
    assert main(["campaign", str(path), "--json"]) == 2
    error = capsys.readouterr().err
    assert str(path) in error
    assert message in error
    assert error.count("\n") == 1


def test_correlations_that_contradict_each_other_are_refused(tmp_path):
    text = HEAD + "".join(
        f"{table}condition.noise = {{uniform = [0, 1]}}\n"
        "speed_kmh = {uniform = [50, 60]}\noption.friction = {uniform = [0.5, 1]}\n"
        for table in ["[draw]\n"]
    )
    names = ["condition.noise", "speed_kmh", "option.friction"]
    for first, second, rank in ((0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9)):
        text += f'[[correlation]]\nof = ["{names[first]}", "{names[second]}"]\nrank = {rank}\n'
    with pytest.raises(CanrollError, match="contradict each other"):
        load(written(tmp_path, text), {}, runs=None, seed=None).plan()


def test_several_descriptions_are_listed_and_all_read(tmp_path):
    files = split_bus.write(tmp_path)
    path = tmp_path / "campaign.toml"
    listed = json.dumps(list(map(str, files)))
    text = 'schema = 1\nscenario = "roundabout"\nruns = 4\n[run]\nactuator = "suspension"\n'
    path.write_text(text + f'map = "{split_bus.MAP}"\ndbc = {listed}\n', encoding="utf-8")
    plan = load(path, {}, runs=None, seed=None).plan()
    assert plan.settings.profile.dbc == files
    assert {"car.dbc", "actuators.dbc"} <= {name for name, _ in plan.description["files"]}
    path.write_text(text + f'map = "{split_bus.MAP}"\ndbc = [3]\n', encoding="utf-8")
    with pytest.raises(CanrollError, match=r"dbc=\[3\]: must be a path, a list of texts or paths"):
        load(path, {}, runs=None, seed=None)


@pytest.mark.parametrize("name", ["suv_2020", "van_real", "sedan_320i"])
def test_a_softer_car_of_a_population_can_be_driven(name):
    campaign = of_options(
        "double_lane_change", {"vehicle": name}, runs=1, seed=0, spread={}, buses=[], faults=[]
    )
    nominal = campaign.plan().settings
    softer = quantities.drawn(nominal, {"vehicle.roll_stiffness": 0.75}, seed=1).vehicle
    build_parameters(softer)
    assert softer.plant.roll_stiffness == 0.75 * vehicles.load(name).plant.roll_stiffness


def test_the_page_shows_a_file_with_every_key(tmp_path):
    page = (Path(__file__).parents[4] / "docs" / "campaign.md").read_text(encoding="utf-8")
    text = re.search(r"^```toml campaign.toml\n(.*?)^```", page, re.M | re.S)[1]
    campaign = load(written(tmp_path, text), {}, runs=None, seed=None)
    assert (campaign.runs, campaign.sampling.seed, campaign.sampling.chunk) == (10_000, 1, 64)
    assert campaign.correlations
    assert {"vehicle.sprung_mass", "speed_kmh", "bus", "faults"} <= campaign.draw.keys()
    assert all(re.search(rf"^{key} = ", text, re.M) for key in KEYS)
    assert all(f"\n[{table}]" in text or f"\n[[{table}]]" in text for table in TABLES)
