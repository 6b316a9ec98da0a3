"""Vehicles with tables of their axles: what follows from these, what the file still says."""

import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness
from canroll.vehicles.unladen import unladen

SPRING = "compression [mm], force [N]\n0, 0\n100, 2300\n130, 3050\n170, 4550\n240, 9600\n"
DAMPER = "compression_speed [m/s], force [N]\n-1, -2000\n0, 0\n1, 1000\n"
BAR = "bar = {torsional_stiffness = 800.0, lever = 0.2, ratio = 0.6}\n"


STEERING = """steering = {"steering_wheel [deg]" = [-700, -90, 0, 90, 700], \
"road_wheel [deg]" = [-36, -5, 0, 5.5, 40]}
steering_system = {torsional_stiffness = 2e4, caster_trail = 0.02}
"""


@pytest.fixture
def load(tmp_path):
    (tmp_path / "spring.csv").write_text(SPRING)
    (tmp_path / "damper.csv").write_text(DAMPER)
    (tmp_path / "kc.csv").write_text("compression [mm], side [mm]\n-50, -4\n0, 0\n50, 3\n")

    def of(front='spring = "spring.csv"', rear="", more="", base="sedan_320i", name="car"):
        path = tmp_path / f"{name}.toml"
        content = f'base = "{base}"\n{more}\n[axles.front]\n{front}\n[axles.rear]\n{rear}\n'
        path.write_text(content)
        return vehicles.load(path)

    return of


def test_numbers_follow_from_tables(load):
    car = load(
        f'spring = "spring.csv"\ndamper = "damper.csv"\nkinematics = "kc.csv"\n{BAR}',
        f'damper = "damper.csv"\n{BAR}',
    )
    base = vehicles.load("sedan_320i")
    tracks = car.geometry.half_track_front, car.geometry.half_track_rear
    assert car.suspension.spring_rate_front == pytest.approx(25e3, rel=0.01)
    assert car.suspension.spring_rate_rear == base.suspension.spring_rate_rear
    damping = [2 * track**2 * 1500.0 for track in tracks]
    assert car.plant.roll_damping == pytest.approx(sum(damping))
    assert car.suspension.roll_damping_front_share == pytest.approx(damping[0] / sum(damping))
    assert car.suspension.rebound_bump_ratio == pytest.approx(2.0)
    assert car.geometry.roll_centre_height_front == pytest.approx(tracks[0] * 0.07)
    bars = [4 * track**2 * 800.0 * (0.6 / 0.2) ** 2 for track in tracks]
    rates = car.suspension.spring_rate_front, car.suspension.spring_rate_rear
    springs = [2 * track**2 * rate for track, rate in zip(tracks, rates, strict=True)]
    assert suspension_roll_stiffness(car) == pytest.approx(sum(bars) + sum(springs), rel=1e-9)
    assert car.design == car.plant
    assert car.source("axles.front") == "spring.csv, damper.csv, kc.csv"
    assert car.source("suspension.spring_rate_front") == "follows from axles.front.spring"


def test_the_ratio_on_centre_follows_from_the_table_of_the_steering(load):
    car = load(STEERING)
    # the mean of both sides: of both wheels, as the right one is the left one's mirror image
    assert car.steering.ratio == pytest.approx(90 / 5.25)
    assert car.source("steering.ratio") == "follows from axles.front.steering"
    assert "ratio" not in car.document["steering"]
    again = vehicles.from_table(car.document, name="again")
    assert again.fingerprint == car.fingerprint and again.steering == car.steering
    assert again.axles == car.axles and again.understeer == car.understeer
    stiffer = car.replace({"axles.front.steering_system.torsional_stiffness": 1e9})
    base = vehicles.load("sedan_320i")
    assert stiffer.understeer == pytest.approx(base.understeer, abs=1e-7)
    assert car.understeer > base.understeer + 5e-4
    # the road wheels' part of the steering is the linear car's, whatever the ratio
    assert stiffer.lateral_gain(20.0) == pytest.approx(base.lateral_gain(20.0), rel=1e-4)


def test_the_tables_of_a_steering_come_with_it_and_not_with_the_suspension(load, tmp_path):
    table = f'{STEERING}spring = "spring.csv"'
    car, plain = load(table), vehicles.load("sedan_320i")
    steered = {"steering": car.axles.front.steering, "system": car.axles.front.steering_system}
    file = str(tmp_path / "car.toml")
    for base, sections, of_steering, spring in (
        ("van_real", {"steering": file}, car, False),
        (file, {"suspension": "sedan_320i"}, car, False),
        (file, {"steering": "sedan_320i"}, plain, True),
        ("sedan_320i", {"suspension": file}, plain, True),
        ("sedan_320i", {"suspension": file, "steering": file}, car, True),
    ):
        other = vehicles.load({"base": base, "title": "other", **sections})
        front = other.axles.front
        assert other.steering == of_steering.steering
        given = {"steering": front.steering, "system": front.steering_system}
        assert given == (steered if of_steering is car else dict.fromkeys(steered))
        assert (front.spring is not None) == spring
        if of_steering is car:
            assert other.source("axles.front.steering").startswith("of ")


def test_a_car_based_on_one_with_an_unusual_steering_means_it(load, tmp_path):
    slow = STEERING.replace("-5, 0, 5.5", "-2, 0, 2")
    with pytest.raises(CanrollError, match=r"steering.ratio = 45 is implausible"):
        load(slow, more="steering.angle_limit = 0.25")
    load(slow, more='unusual = ["steering.ratio"]\nsteering.angle_limit = 0.25', name="slow")
    heavier = {"base": str(tmp_path / "slow.toml"), "plant": {"sprung_mass": 1000.0}}
    assert vehicles.load(heavier).steering.ratio == pytest.approx(45.0)


def test_the_document_stands_alone(load):
    car = load(f'spring = "spring.csv"\n{BAR}', BAR)
    again = vehicles.from_table(car.document, name="again")
    assert again.fingerprint == car.fingerprint and again.plant == car.plant
    assert "spring_rate_front" not in car.document["suspension"]
    assert "roll_stiffness" not in car.document["design"]
    assert vehicles.load(car).axles == car.axles
    assert hash(again) == hash(vehicles.load(car)) or again != car


def test_a_car_based_on_one_has_its_tables_or_others(load, tmp_path):
    car = load('spring = "spring.csv"\nkinematics = "kc.csv"')
    stiffer = {"compression [m]": [0.0, 0.2], "force [N]": [0.0, 6000.0]}
    table = {"base": str(tmp_path / "car.toml"), "axles": {"front": {"spring": stiffer}}}
    other = vehicles.load(table)
    assert other.suspension.spring_rate_front == pytest.approx(30e3)
    assert other.axles.front.side == car.axles.front.side
    taken = vehicles.load({"base": "sedan_320i", "suspension": str(tmp_path / "car.toml")})
    assert taken.axles == car.axles
    load(name="springs")
    back = vehicles.load({"base": str(tmp_path / "springs.toml"), "suspension": "sedan_320i"})
    assert back.axles is None and back.suspension == vehicles.load("sedan_320i").suspension


def test_a_heavier_and_an_empty_car_stand_elsewhere_on_their_springs(load):
    car = load()
    heavier = car.replace({"plant.sprung_mass": 1.3 * car.plant.sprung_mass})
    low, middle, high = (axles(each)[0].curves.rest for each in (heavier, car, unladen(car)))
    assert high < -0.005 and abs(middle) < 1e-12 and low > 0.005
    assert heavier.suspension.spring_rate_front > car.suspension.spring_rate_front
    # the bars stay what they are
    bars = [axles(each)[0].bar(suspension_roll_stiffness(each)) for each in (car, unladen(car))]
    assert bars[1] == pytest.approx(bars[0], rel=1e-6)


@pytest.mark.parametrize(
    ("front", "more", "message"),
    [
        ('damper = "damper.csv"', "", "axles.rear.damper is missing: both axles need one"),
        (BAR, "", "axles.rear.bar is missing"),
        ('spring = "no.csv"', "", "cannot read table .*no.csv"),
        (
            'spring = "spring.csv"',
            "suspension.spring_rate_front = 2e4",
            "suspension.spring_rate_front follows from axles.front.spring: remove it",
        ),
        (
            'kinematics = "kc.csv"',
            "geometry.roll_centre_height_front = 0.1",
            "roll_centre_height_front follows from axles.front.kinematics",
        ),
        (STEERING, "steering.ratio = 16.0", "steering.ratio follows from axles.front.steering"),
        (
            STEERING,
            "steering.angle_limit = 0.8",
            r"steering ends at 700° .* 0.8 is 786°, .* 17.14: .* lower the limit to 0.7127",
        ),
        (
            'spring = {"compression [m]" = [0.0, 0.1], "force [N]" = [0.0, 500.0]}',
            "",
            "carries 0 to",
        ),
    ],
)
def test_what_contradicts_the_tables_is_refused_in_one_line(load, front, more, message):
    with pytest.raises(CanrollError, match=message) as caught:
        load(front, more=more)
    assert "\n" not in str(caught.value)


def test_what_follows_cannot_be_changed(load):
    with pytest.raises(CanrollError, match=r"steering.ratio follows from axles.front.steering"):
        load(STEERING).replace({"steering.ratio": 15.0})
    car = load()
    with pytest.raises(CanrollError, match=r"spring_rate_front follows from axles.front.spring"):
        car.replace({"suspension.spring_rate_front": 2e4})
    softer = [0.0, 2300.0, 3000.0, 4550.0, 9600.0]
    changed = car.replace({"axles.front.spring.force [N]": softer})
    assert changed.suspension.spring_rate_front < car.suspension.spring_rate_front
