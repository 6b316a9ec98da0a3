"""Whatever is done to a vehicle file, it is refused in one line or gives a car that drives."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world import open_loop

TEXT = (Path(vehicles.__file__).parent / "van_real.toml").read_text()
SECTIONS = ("design", "plant", "geometry", "mass", "suspension", "tyre", "steering", "driver")
KEYS = [(section, key) for section in SECTIONS for key in tomllib.loads(TEXT)[section]]

ANYTHING = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(-(10**9), 10**9),
    st.booleans(),
    st.text(max_size=5),
    st.none(),
    st.lists(st.floats(), max_size=3),
)
FACTOR = st.floats(0.5, 2.0)


@pytest.mark.slow
@given(st.sampled_from(KEYS), ANYTHING)
def test_any_value_is_loaded_or_refused_in_one_line(where, value):
    table = tomllib.loads(TEXT)
    section, key = where
    table[section][key] = value
    try:
        vehicle = vehicles.from_table(table, name="x", where="x.toml")
    except CanrollError as refusal:
        assert "\n" not in str(refusal) and str(refusal).startswith("x.toml: ")
    else:
        assert getattr(getattr(vehicle, section), key) == float(value)


@given(st.lists(st.tuples(st.sampled_from(KEYS), FACTOR), min_size=1, max_size=4))
@settings(suppress_health_check=[HealthCheck.too_slow])
def test_every_accepted_vehicle_stands_on_four_wheels_and_turns_left(changes):
    table = tomllib.loads(TEXT)
    for (section, key), factor in changes:
        table[section][key] *= factor
    try:
        vehicle = vehicles.from_table(table, name="x", where="x.toml")
        built = {body.name: body.build(vehicle, 15.0) for body in bodies.BODIES.values()}
    except CanrollError as refusal:
        assert "\n" not in str(refusal)
        return
    for name, (state, parameters) in built.items():
        inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
        step = bodies.body(name).step
        open_loop.advance(step, state, inputs, parameters, outputs, 0.0)
        loads = outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
        weight = vehicle.total_mass * vehicles.GRAVITY
        assert np.all(loads > 0) and abs(loads.sum() / weight - 1) < 1e-9
        inputs[ports.STEER] = 0.01
        for _ in range(300):
            open_loop.advance(step, state, inputs, parameters, outputs, 1e-3)
        assert np.isfinite(outputs).all()
        assert outputs[ports.YAW_RATE] > 0
