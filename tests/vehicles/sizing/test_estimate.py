"""Vehicles estimated from mass and size: against measured cars, and back to their own ratios."""

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

import vehicles
from canroll.errors import CanrollError
from vehicles.sizing.classes import CLASSES
from vehicles.sizing.estimate import SIZES, estimated
from vehicles.sizing.review import RATIO_OF, beside_class, handling

pytest.importorskip("vehiclemodels", reason="needs commonroad-vehicle-models")
from vehiclemodels.parameters_vehicle1 import parameters_vehicle1
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.parameters_vehicle3 import parameters_vehicle3

VAN = {"mass": 2720.0, "wheelbase": 3.66, "track": 1.735, "height": 2.5}


@pytest.mark.parametrize(
    ("kind", "measured", "height"),
    [
        ("car", parameters_vehicle1(), 1.35),
        ("car", parameters_vehicle2(), 1.38),
        ("van", parameters_vehicle3(), 1.93),
    ],
)
def test_a_measured_car_is_estimated_within_a_few_spreads(kind, measured, height):
    vehicle = estimated(
        kind,
        {
            "mass": measured.m,
            "wheelbase": measured.a + measured.b,
            "track": (measured.T_f + measured.T_r) / 2,
            "height": height,
            "front_share": measured.b / (measured.a + measured.b),
        },
        name="measured",
    )
    assert vehicle.cg_height == pytest.approx(measured.h_cg, rel=0.07)
    assert vehicle.mass.yaw_inertia == pytest.approx(measured.I_z, rel=0.12)
    assert vehicle.mass.pitch_inertia == pytest.approx(measured.I_y_s, rel=0.12)
    assert vehicle.plant.inertia_about_cg == pytest.approx(measured.I_Phi_s, rel=0.1)
    assert vehicle.plant.sprung_mass == pytest.approx(measured.m_s, rel=0.03)
    assert vehicle.tyre.vertical_stiffness == pytest.approx(measured.K_zt, rel=0.2)
    assert vehicle.suspension.spring_rate_front == pytest.approx(measured.K_sf, rel=0.25)
    assert vehicle.suspension.spring_rate_rear == pytest.approx(measured.K_sr, rel=0.25)


@given(
    kind=st.sampled_from(sorted(CLASSES)),
    mass=st.floats(900, 3500),
    wheelbase=st.floats(2.3, 3.9),
    track=st.floats(1.35, 1.8),
)
def test_the_ratios_of_an_estimated_vehicle_are_those_of_its_class(kind, mass, wheelbase, track):
    sizes = {"mass": mass, "wheelbase": wheelbase, "track": track, "height": 1.0 * track}
    vehicle = estimated(kind, sizes, name="x")
    for name, ratio_of in RATIO_OF.items():
        assert ratio_of(vehicle) == pytest.approx(getattr(CLASSES[kind], name).value, rel=5e-3), (
            name
        )
    assert all(quantity.usual for quantity in beside_class(vehicle, kind))
    assert vehicle.total_mass == pytest.approx(mass, rel=1e-3)


def test_every_number_says_whether_it_was_estimated():
    vehicle = estimated("van", {**VAN, "front_share": 0.5}, name="mine")
    assert vehicle.source("geometry.half_track_front") == "given"
    assert vehicle.source("geometry.cg_to_front_axle") == "given by front share"
    text = vehicle.source("mass.yaw_inertia")
    assert text.startswith("estimated ±12 % by yaw index, front share: ")
    assert vehicle.source("actuators.bars.lag").startswith("of van_real: ")
    assert vehicles.load(vehicle.document).fingerprint == vehicle.fingerprint


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("lorry", {}, "unknown class of vehicles 'lorry'"),
        ("van", {"mass": None}, "a vehicle needs its mass"),
        ("van", {"mass": -1.0}, "mass -1: must be 300 to 40000"),
        ("van", {"front_share": 0.0}, "front_share 0: must be positive"),
        ("van", {"heights": 2.0}, "did you mean 'height'"),
        ("van", {"track": 1.0, "height": 4.4}, "roll_stiffness"),
    ],
)
def test_what_makes_no_vehicle_is_refused(kind, changes, message):
    known = {key: value for key, value in {**VAN, **changes}.items() if value is not None}
    with pytest.raises(CanrollError, match=message):
        estimated(kind, known, name="x")


def test_a_vehicle_is_shown_beside_its_class():
    van = vehicles.load("van_real")
    rows = {quantity.label: quantity for quantity in (*handling(van), *beside_class(van, "van"))}
    assert rows["roll gradient"].value == pytest.approx(van.plant.roll_gradient_deg_per_g)
    assert rows["front share of the weight"].value == pytest.approx(1.91 / 3.66)
    assert not rows["damping ratio in roll"].usual
    assert rows["static stability factor"].usual


def test_a_class_has_all_its_ratios():
    assert {field.name for field in fields(CLASSES["van"])} == {
        "title",
        "base",
        "cg_height",
        "front_bar",
        *RATIO_OF,
    }
    assert set(SIZES) == set(VAN)
