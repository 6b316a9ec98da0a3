"""Short vehicle files, changes, and a truck on the base of a car."""

import json

import pytest

from canroll import run, vehicles
from canroll.errors import CanrollError, UnknownNameError

TRUCK = """
title = "Truck of 10 t"
base = "van_real"

[plant]
roll_inertia = 17000.0
roll_damping = 70000.0
roll_stiffness = 900000.0
sprung_mass = 8800.0
cg_height_above_roll_axis = 0.9

[geometry]
cg_to_front_axle = 2.6
cg_to_rear_axle = 1.9
half_track_front = 1.0
half_track_rear = 0.95
roll_centre_height_front = 0.5
roll_centre_height_rear = 0.7
width = 2.5

[mass]
unsprung_front = 500.0
unsprung_rear = 700.0
pitch_inertia = 45000.0
yaw_inertia = 50000.0

[suspension]
spring_rate_front = 150000.0
spring_rate_rear = 230000.0
roll_stiffness_front_share = 0.45

[tyre]
cornering_stiffness_front = 300000.0
cornering_stiffness_rear = 450000.0
longitudinal_stiffness = 400000.0
vertical_stiffness = 1600000.0
radius = 0.5
wheel_inertia = 20.0
"""


@pytest.fixture
def truck(tmp_path):
    path = tmp_path / "truck.toml"
    path.write_text(TRUCK, encoding="utf-8")
    return path


def test_a_short_file_inherits_numbers_and_marks_them(truck):
    vehicle, base = vehicles.load(truck), vehicles.load("van_real")
    assert vehicle.plant.sprung_mass == 8800.0
    assert vehicle.source("plant.sprung_mass") == "given by this file"
    assert vehicle.tyre.shape == base.tyre.shape
    assert vehicle.source("tyre.shape") == f"of base van_real: {base.source('tyre.shape')}"
    assert vehicle.design == vehicle.plant
    assert vehicle.empty is None
    document = json.loads(json.dumps(vehicle.document))
    again = vehicles.from_table(document, name=vehicle.name)
    assert again.fingerprint == vehicle.fingerprint


def test_a_section_is_taken_from_a_vehicle_and_a_base_from_a_file(truck):
    other = truck.with_name("other.toml")
    other.write_text(
        'base = "truck.toml"\nsensors = "sedan_320i"\n[sources]\ntyre = "data sheet"\n'
        "[tyre]\nradius = 0.52\n",
        encoding="utf-8",
    )
    vehicle, sedan = vehicles.load(other), vehicles.load("sedan_320i")
    assert vehicle.sensors == sedan.sensors
    assert vehicle.source("sensors.speed") == f"of sedan_320i: {sedan.source('sensors')}"
    assert vehicle.source("tyre.radius") == "data sheet"
    assert vehicle.plant == vehicles.load(truck).plant


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('base = "sedan_320"', "did you mean 'sedan_320i'"),
        ('base = "own.toml"', "refers back to it"),
        ("base = 3", "'base' must be the name"),
        ('base = "van_real"\n[tyre]\nradus = 0.3', "unknown key 'radus'"),
        ('base = "van_real"\n[plant]\ninertia = 2000.0', r"\[plant\] unknown key 'inertia'"),
        ('base = "van_2021"\nempty = "suv_2020"', "has no section 'empty'"),
    ],
)
def test_a_wrong_short_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CanrollError, match=message) as refusal:
        vehicles.load(path)
    assert "own.toml" in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_vehicle_with_other_numbers():
    van = vehicles.load("van_real")
    heavier = van.replace({"plant.sprung_mass": 2500})
    assert heavier.name == "van_real with plant.sprung_mass=2500"
    assert heavier.plant.sprung_mass == heavier.design.sprung_mass == 2500.0
    assert heavier.fingerprint != van.fingerprint
    with pytest.raises(UnknownNameError, match=r"did you mean 'plant\.sprung_mass'"):
        van.replace({"plant.sprung_mas": 2500})
    with pytest.raises(CanrollError, match="must be less than the laden body's"):
        van.replace({"plant.sprung_mass": 2500, "empty.sprung_mass": 2500})


def test_a_dictionary_is_a_vehicle():
    vehicle = vehicles.load({"base": "sedan_320i", "tyre": {"friction": 0.9}})
    assert vehicle.tyre.friction == 0.9


def test_a_truck_of_10_t_drives_a_lane_change(truck):
    result = run("double_lane_change", vehicle=truck, law="lqr", speed_kmh=50)
    assert 0 < result.controlled.signals["roll"].max() < 0.2
    passive = run("double_lane_change", vehicle=truck, law="passive", speed_kmh=50)
    assert 0 < passive.passive.signals["roll"].max() < 0.2


def test_monitors_that_a_heavy_body_exceeds_are_off_with_a_warning(truck):
    heavy = {"plant.roll_inertia": 60e3, "mass.pitch_inertia": 9e4, "mass.yaw_inertia": 1e5}
    vehicle = vehicles.load(truck).replace(heavy)
    result = run("double_lane_change", vehicle=vehicle, law="lqr", speed_kmh=50)
    assert 0 < result.controlled.signals["roll"].max() < 0.3
    assert not result.controlled.ticks["fault_codes"].any()
    assert any("design m h = 7920 kg·m reach 79 kN·m" in text for text in result.warnings)
    own = {"vehicle": vehicle, "law": "lqr", "response_watch": False, "identification": True}
    asked = run("double_lane_change", speed_kmh=50, **own)
    assert not any("kN·m" in text for text in asked.warnings)
