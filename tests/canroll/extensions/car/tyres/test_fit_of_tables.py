"""Tyres fitted to tables: forces of public implementations, noise, and what a table cannot tell."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import tyre_references as references

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.extensions.car.tyres.measured import MeasuredTyre
from canroll.extensions.car.tyres.tyre_fit import fit, lateral_forces
from canroll.extensions.car.tyres.tyre_view import file_text, untold_lines
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world import open_loop
from canroll.vehicles.tyres import tir
from canroll.vehicles.tyres.magic_formula import Coefficients

FOLDER = Path(__file__).parents[4] / "vehicles" / "tyres"
NOISE = 20.0


def truth(name="passenger_61"):
    return Coefficients({**tir.read(FOLDER / f"{name}.tir").values, "INFLPRES": 220e3})


def grid(loads=(2000.0, 3000.0, 4500.0, 6000.0), cambers=(-4.0, 0.0, 4.0)):
    """Slip angle (rad), load (N), camber (rad); the middle of the loads is FNOMIN of the files."""
    slips = np.linspace(-15, 15, 31)
    mesh = np.meshgrid(np.radians(slips), loads, np.radians(cambers), indexing="ij")
    return tuple(axis.ravel() for axis in mesh)


def measured(points, seed=1, noise=NOISE):
    slip, load, camber = points
    force = lateral_forces(truth(), slip, load, camber)
    force += noise * np.random.default_rng(seed).standard_normal(len(force))
    return MeasuredTyre("t.csv", slip, load, camber, force)


@pytest.mark.parametrize("judge", ["mfeval", "tyredyn"])
@pytest.mark.parametrize("name", ["passenger_61", "passenger_62"])
def test_forces_of_public_implementations_are_met_also_where_none_is_in_the_table(name, judge):
    kept = np.load(FOLDER / "references.npz")[f"{name}_{judge}"]
    points = references.grid()[:: references.KEPT]
    # without longitudinal slip, at nominal pressure
    free = (points[:, 1] == 0.0) & (points[:, 4] == 220e3)
    load, _, slip, camber, _ = points[free].T
    fitted = fit(MeasuredTyre(judge, slip, load, camber, kept[free, 1]))
    assert len(fitted.table) == 36
    assert np.abs(fitted.errors).max() < 1e-4 * np.abs(kept[free, 1]).max()
    slip, load, camber = grid((500.0, 3000.0, 5000.0, 8000.0), (-5.0, 0.0, 5.0))
    own, expected = (lateral_forces(t, slip, load, camber) for t in (fitted.tyre, truth(name)))
    assert np.abs(own - expected).max() < 2e-3 * np.abs(expected).max()


def test_a_file_of_version_5_2_is_fitted_from_itself():
    kept = np.load(FOLDER / "references.npz")["passenger_52_mfeval"]
    points = references.grid()[:: references.KEPT]
    free = points[:, 1] == 0.0
    load, _, slip, camber, _ = points[free].T
    start = tir.read(FOLDER / "passenger_52.tir").values
    start = {**start, "PCY1": 1.5, "PDY1": 1.2, "PKY1": -17.0, "PVY3": 0.0, "PDY2": -0.3}
    fitted = fit(MeasuredTyre("t", slip, load, camber, kept[free, 1]), Coefficients(start))
    assert np.abs(fitted.errors).max() < 1e-5 * np.abs(kept[free, 1]).max()
    assert fitted.tyre["PCX1"] == start["PCX1"] and fitted.guessed == ()
    assert "PHY3" in {number.unknown.key for number in fitted.numbers}


def test_stated_deviations_hold_and_forces_are_nearer_than_the_noise():
    points, known = grid(), truth()
    exact = lateral_forces(known, *points)
    inside = []
    for seed in range(6):
        table = measured(points, seed)
        fitted = fit(table)
        drawn = np.sqrt(np.mean((table.force - exact) ** 2))
        assert 0.92 * drawn < fitted.rms < drawn
        own = lateral_forces(fitted.tyre, *points)
        assert np.sqrt(np.mean((own - exact) ** 2)) < 0.35 * NOISE
        inside += [
            abs(number.value - known[number.unknown.key]) < 1.96 * number.deviation
            for number in fitted.numbers
        ]
    assert np.mean(inside) > 0.88


def test_one_load_without_camber_tells_neither_load_nor_camber():
    fitted = fit(measured(grid((4000.0,), (0.0,)), noise=2.0))
    kept = {number.unknown.key for number in fitted.of_state("kept")}
    over_load = {"PDY2", "PEY2", "PHY2", "PVY2", "PKY7", "PVY4"}
    over_camber = {"PDY3", "PEY4", "PEY5", "PKY3", "PKY5", "PKY6", "PVY3"}
    assert kept == over_load | over_camber
    assert all(n.value == n.unknown.mean for n in fitted.of_state("kept"))
    assert {"PDY1", "PCY1", "PHY1"} <= {n.unknown.key for n in fitted.of_state("identified")}
    # the stiffness at this load is known, the load of its maximum is not
    assert ("PKY1", "PKY2") in [pair[:2] for pair in fitted.pairs]
    assert "loads of 4000 N only" in fitted.remarks[0]
    assert "cambers of 0.0° only" in fitted.remarks[1]
    assert "PDY2 (grip, over load)" in next(untold_lines(fitted))


def test_limits_are_those_of_the_table_and_one_side_is_mirrored():
    table = measured(grid())
    tyre = fit(table).tyre
    assert (tyre["FZMIN"], tyre["FZMAX"]) == (2000.0, 6000.0)
    assert tyre["ALPMAX"] == pytest.approx(np.radians(15)) and tyre["ALPMIN"] == -tyre["ALPMAX"]
    assert tyre["CAMMAX"] == pytest.approx(np.radians(4))
    of = table.camber >= 0.0
    part = MeasuredTyre(
        "t", *(v[of] for v in (table.slip_angle, table.load, table.camber)), table.force[of]
    )
    fitted = fit(part)
    assert fitted.tyre["CAMMIN"] == -fitted.tyre["CAMMAX"]
    assert fitted.remarks == ("cambers up to 4.0° on one side only: the other is by the formula",)


def test_too_few_points_and_a_scaled_start_are_refused():
    few = measured(tuple(axis[:12] for axis in grid()))
    with pytest.raises(CanrollError, match=r"t.csv: 12 points, but 2\d coefficients depend"):
        fit(few)
    start = Coefficients({**truth().values, "LMUY": 0.8})
    with pytest.raises(CanrollError, match=r"LMUY = 0\.8 scales the lateral force"):
        fit(measured(grid()), start)


def test_grip_that_falls_over_load_is_named():
    table = measured(grid(), noise=0.0)
    odd = replace(table, force=table.force * 2000.0 / table.load)
    assert any("falls over load" in remark for remark in fit(odd).remarks)


def test_the_file_is_read_again_and_drives(tmp_path):
    fitted = fit(measured(grid()), radius=0.31)
    path = tmp_path / "own.tir"
    path.write_text(file_text(fitted))
    again = tir.read(path)
    assert {key: again[key] for key in fitted.tyre.values} == pytest.approx(
        dict(fitted.tyre.values), rel=1e-8
    )
    car = vehicles.load({"base": "sedan_320i", "tyre": {"file": str(path)}, "title": "own"})
    assert car.tyre.friction == pytest.approx(fitted.tyre.friction(car.wheel_loads[0]), rel=0.05)
    body = bodies.body("nonlinear")
    state, numbers = body.build(car, 18.0)
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    inputs[ports.STEER] = 0.02
    for _ in range(1000):
        open_loop.advance(body.step, state, inputs, numbers, outputs, 1e-3)
    turned = 18.0 * 0.02 / (car.geometry.wheelbase + car.understeer * 18.0**2)
    assert outputs[ports.YAW_RATE] == pytest.approx(turned, rel=0.15)


def test_what_the_start_has_besides_stays_in_the_file(tmp_path):
    text = (FOLDER / "passenger_61.tir").read_text() + "[OTHER]\nQSY1 = 0.01 $ mine\n"
    start = {**truth().values, "INFLPRES": 240e3}
    table = measured(grid())
    path = tmp_path / "own.tir"
    path.write_text(file_text(fit(table, Coefficients({**start, "INFLPRES": 220e3})), text))
    again = tir.read(path)
    assert "QSY1 = 0.01 $ mine" in path.read_text()
    assert again["QDZ1"] == start["QDZ1"] and again["INFLPRES"] == 240e3
    assert again["FZMAX"] == 6000.0 and again["PDY1"] == pytest.approx(1.02, rel=0.02)
    assert path.read_text().count("PDY1 ") == 1 and "$ fitted, ±" in path.read_text()
