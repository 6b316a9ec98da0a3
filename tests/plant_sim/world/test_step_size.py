"""A vehicle too stiff for the step is refused before the run; all that we ship are not."""

import re
from pathlib import Path

import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import can_bus
from canroll.plant_sim.bodies import BODIES, body
from canroll.plant_sim.bodies.ports import initial_inputs
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world.step_size import check_step, growth_per_step
from canroll.plant_sim.world.world import World
from canroll.vehicles import plausible

VAN = Path(vehicles.__file__).with_name("van_real.toml")


def scaled(path, key, factor):
    """A van with every ``key`` of its file multiplied."""
    text = re.sub(
        rf"^{key} = ([\d.]+)$",
        lambda found: f"{key} = {float(found[1]) * factor}",
        VAN.read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    path.write_text(f"unusual = {list(plausible.KEYS)}\n{text}", encoding="utf-8")
    return vehicles.load(str(path))


@pytest.mark.parametrize("name", vehicles.names())
def test_every_vehicle_can_be_driven_at_every_speed(name):
    for plant in map(body, BODIES):
        for kmh in (5, 30, 80, 160):
            state, parameters = plant.build(vehicles.load(name), kmh / 3.6)
            check_step(plant, state, initial_inputs(), parameters)


@pytest.mark.parametrize(
    ("key", "plant"),
    [
        ("roll_damping", "roll1"),
        ("roll_damping", "nonlinear"),
        ("cornering_stiffness_rear", "linear_car"),
        ("longitudinal_stiffness", "nonlinear"),
        ("vertical_damping", "nonlinear"),
    ],
)
def test_a_thousandfold_is_refused_in_one_line(key, plant, tmp_path):
    vehicle = scaled(tmp_path / "van.toml", key, 1000)
    with pytest.raises(CanrollError, match="unstable at the fixed step of 1 ms") as refused:
        World(
            vehicle=vehicle,
            body=plant,
            actuator="bars",
            maneuver=maneuvers.build("double_lane_change", vehicle),
            profile=can_bus.load_profile("500k"),
        )
    assert "\n" not in str(refused.value)
    causes = str(refused.value).partition(": check ")[2]
    assert f".{key} (lower it)" in causes


def test_the_growth_is_that_of_the_step(tmp_path):
    """A roll mode with damping a thousand times too strong: Runge-Kutta's own polynomial."""
    van = scaled(tmp_path / "van.toml", "roll_damping", 1000)
    plant = body("roll1")
    state, parameters = plant.build(van, 20.0)
    growth = growth_per_step(plant, state, initial_inputs(), parameters)
    inertia, damping, stiffness = (
        van.plant.roll_inertia,
        van.plant.roll_damping,
        van.plant.roll_stiffness - van.plant.roll_arm * vehicles.GRAVITY,
    )
    fast = -(damping + (damping**2 - 4 * inertia * stiffness) ** 0.5) / (2 * inertia)
    z = 1e-3 * fast
    assert growth == pytest.approx(abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24), rel=1e-3)
