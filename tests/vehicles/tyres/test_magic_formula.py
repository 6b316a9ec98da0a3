"""The Magic Formula tyre: values of two public implementations, signs, sides and what designs take.

The values are those of two public implementations; support/tyre_references.py has their sources.
"""

from math import sin, tan
from pathlib import Path

import numpy as np
import pytest
from support import tyre_references as references

from canroll.vehicles.tyres import tir
from canroll.vehicles.tyres.magic_formula import Coefficients, MagicFormula

FOLDER = Path(__file__).parent
NAMES = ("passenger_52", "passenger_61", "passenger_62")


def tyre(name, **changed):
    values = tir.read(FOLDER / f"{name}.tir").values
    return MagicFormula.of(Coefficients({**values, **changed}))


@pytest.mark.parametrize("name", NAMES)
def test_forces_are_those_of_public_implementations(name):
    points = references.grid()[:: references.KEPT]
    tyres = {p: tyre(name, INFLPRES=p) for p in references.PRESSURES}
    side = tyres[220e3].coefficients["TYRESIDE"]
    found = np.array(
        [
            tyres[p].forces(load, ratio, -tan(angle), sin(camber), 1.0, side)
            for load, ratio, angle, camber, p in points
        ]
    )
    kept = np.load(FOLDER / "references.npz")
    judges = [key for key in kept if key.startswith(name)]
    assert judges
    for judge in judges:
        theirs = kept[judge]
        least = 0.01 * np.abs(theirs).max(axis=0)
        difference = np.abs(found[:, : theirs.shape[1]] - theirs)
        assert (difference <= 1e-6 * np.maximum(np.abs(theirs), least)).all(), judge


@pytest.mark.parametrize("name", NAMES)
def test_a_tyre_pushes_against_its_slip_and_turns_into_it(name):
    model, load = tyre(name), 4000.0
    for hand in (1.0, -1.0):
        _, aside, aligning = model.forces(load, 0.0, 0.05, 0.0, 1.0, hand)
        # pushed to the left behind its middle, the wheel turns to the right, out of the slip
        assert aside > 2000.0 and aligning < -10.0
        assert model.forces(load, 0.03, 0.0, 0.0, 1.0, hand)[0] > 1000.0
        # leaning to the right, it pulls to the right
        lean = model.forces(load, 0.0, 0.0, 0.1, 1.0, hand)[1]
        assert lean < model.forces(load, 0.0, 0.0, -0.1, 1.0, hand)[1] - 300.0


def test_left_and_right_tyre_are_mirror_images():
    model, load = tyre("passenger_61"), 4000.0
    for ratio, slip, camber in ((0.0, 0.0, 0.0), (0.02, 0.04, 0.03), (-0.1, -0.02, 0.05)):
        left = model.forces(load, ratio, slip, camber, 0.8, 1.0)
        right = model.forces(load, ratio, -slip, -camber, 0.8, -1.0)
        assert left == (right[0], -right[1], -right[2])
    # one alone pulls
    assert abs(model.forces(load, 0.0, 0.0)[1]) > 20.0
    assert tyre("passenger_61", TYRESIDE=-1.0).forces(load, 0.0, 0.05) == model.forces(
        load, 0.0, 0.05, 0.0, 1.0, -1.0
    )


def test_road_friction_scales_the_grip_as_the_files_own_factor():
    slippery = tyre("passenger_61", LMUX=0.4, LMUY=0.4)
    whole = tyre("passenger_61")
    for slips in ((0.01, 0.02, 0.05), (0.4, -0.3, 0.0), (-1.0, 0.1, 0.1)):
        expected = slippery.forces(4000.0, *slips)
        assert whole.forces(4000.0, *slips, 0.4) == pytest.approx(expected, rel=1e-9)
    assert whole.forces(4000.0, 0.1, 0.1, 0.0, 0.0) == (0.0, 0.0, 0.0)
    assert whole.forces(0.0, 0.1, 0.1) == (0.0, 0.0, 0.0)


def test_designs_take_the_mean_of_left_and_right():
    model, load = tyre("passenger_61"), 4000.0
    sides = [model.forces(load, 0.0, 0.03, 0.0, 1.0, hand)[1] for hand in (1.0, -1.0)]
    force, slope = model.lateral(load, 0.03, 1.0)
    assert force == pytest.approx(sum(sides) / 2, rel=1e-12) and sides[0] != sides[1]
    step = 1e-4
    ahead, behind = (model.lateral(load, 0.03 + d, 1.0)[0] for d in (step, -step))
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-5)
    assert model.lateral(load, 0.0, 1.0)[0] == 0.0
    assert model.grip(load, 1.0) == pytest.approx(model.coefficients.grip(load), rel=1e-3)
    assert model.linear(load).cornering == pytest.approx(
        -model.coefficients.cornering(load), rel=0.01
    )


def test_beyond_the_limits_of_validity_forces_are_held():
    model = tyre("passenger_61")
    assert model.forces(20000.0, 0.0, 0.05) == model.forces(9000.0, 0.0, 0.05)
    assert model.forces(4000.0, 5.0, 0.0) == model.forces(4000.0, 1.5, 0.0)
    assert model.forces(4000.0, 0.0, 50.0) == model.forces(4000.0, 0.0, tan(1.3))
    assert model.forces(4000.0, 0.0, 0.0, 0.9) == model.forces(4000.0, 0.0, 0.0, sin(0.2))


def test_relaxation_lengths_are_those_of_the_version():
    # MFeval: sigma_y without camber
    for name, load, length in (
        ("passenger_52", 2000.0, 0.32819301),
        ("passenger_52", 6500.0, 0.65868313),
        ("passenger_61", 2000.0, 0.43516637),
        ("passenger_62", 6500.0, 0.78290915),
    ):
        assert tyre(name).relaxation(load) == pytest.approx(length, abs=5e-9)
    old = tir.read(FOLDER / "passenger_52.tir").values
    without = {key: value for key, value in old.items() if key != "PTY1"}
    assert Coefficients(without).relaxation(4000.0) is None
