"""A vehicle is judged by drives of a known car: itself passes, another one fails."""

import json
from functools import cache
from math import inf

import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError, VerdictError
from canroll.extensions.car.identification.pieces import Window
from canroll.extensions.car.identification.unknowns import value_of
from canroll.extensions.car.validation.manoeuvre import recognised
from canroll.extensions.car.validation.measurement import NONE, Measurement, of_fit, zeroed
from canroll.extensions.car.validation.replayed import replayed
from canroll.extensions.car.validation.tolerances import TOLERANCES, with_choices
from canroll.extensions.car.validation.validate import ValidationSettings, validate
from canroll.extensions.car.validation.validation_page import headline
from tests.support.measured_drives import driven, dwell, free, log_of, ramp, step, sweep

SPEED = 22.0
CORNERING = ("tyre.cornering_stiffness_front", "tyre.cornering_stiffness_rear")
STEERINGS = {
    "step_steer": lambda: step(1.2),
    "sine_sweep": lambda: sweep(0.5),
    "sine_with_dwell": lambda: dwell(1.5),
    "steady_circle": lambda: ramp(1.8),
    "free": free,
}


def car():
    return vehicles.load("van_real")


def softer(*keys, share=0.85):
    return car().replace({key: share * value_of(car(), key) for key in keys})


@cache
def columns(manoeuvre, side=1.0):
    return driven(car(), side * STEERINGS[manoeuvre](), SPEED)


def verdict(manoeuvre, vehicle=None, **changes):
    log = log_of({**columns(manoeuvre), **changes})
    return validate(log, vehicle or car(), ValidationSettings())


@pytest.mark.parametrize("manoeuvre", STEERINGS)
def test_the_car_itself_passes_and_its_manoeuvre_is_recognised(manoeuvre):
    result = verdict(manoeuvre)
    assert result.manoeuvre == manoeuvre
    assert result.passed
    assert not result.failures
    for match in result.matches:
        assert match.explained > 0.9999
        assert match.rating is None or match.rating.overall > 0.999
    assert bool(result.judged.criteria) == (manoeuvre != "free")


@pytest.mark.parametrize("key", CORNERING)
@pytest.mark.parametrize("manoeuvre", STEERINGS)
def test_a_car_with_fifteen_percent_less_cornering_stiffness_fails(manoeuvre, key):
    assert not verdict(manoeuvre, softer(key)).passed


@pytest.mark.parametrize("manoeuvre", [name for name in STEERINGS if name != "steady_circle"])
@pytest.mark.parametrize("signal", ["yaw_rate", "roll_rate", "roll", "lateral_acceleration"])
def test_a_reversed_signal_fails_and_is_named(manoeuvre, signal):
    result = verdict(manoeuvre, **{signal: -columns(manoeuvre)[signal]})
    assert not result.passed
    assert any(signal.replace("_", " ") in text for text in result.failures)
    assert any("sign is reversed" in text for text in result.drive.remarks)


def test_a_reversed_roll_on_a_circle_fails():
    result = verdict("steady_circle", roll=-columns("steady_circle")["roll"])
    assert [band.name for band in result.judged.bands if not band.passed] == ["roll"]


@pytest.mark.parametrize("manoeuvre", [name for name in STEERINGS if name != "free"])
def test_a_manoeuvre_to_the_right_is_the_same(manoeuvre):
    result = validate(log_of(columns(manoeuvre, -1.0)), softer(CORNERING[1]), ValidationSettings())
    assert result.manoeuvre == manoeuvre
    assert not result.passed


@pytest.mark.parametrize("manoeuvre", STEERINGS)
def test_noise_changes_no_verdict(manoeuvre):
    generator = np.random.default_rng(4)
    noise = {"steering": 1e-3, "yaw_rate": 3e-3, "lateral_acceleration": 0.06}
    noise |= {"roll_rate": 4e-3, "roll": 1e-3, "sideslip": 1e-3}
    count = len(columns(manoeuvre)["speed"])
    noisy = {
        name: columns(manoeuvre)[name] + size * generator.standard_normal(count)
        for name, size in noise.items()
    }
    result = verdict(manoeuvre, **noisy)
    assert result.manoeuvre == manoeuvre
    assert result.passed, result.failures


def test_the_manoeuvre_can_be_named_and_a_wrong_one_is_refused():
    log = log_of(columns("sine_sweep"))
    assert validate(log, car(), ValidationSettings(manoeuvre="free")).manoeuvre == "free"
    for name in ("step_steer", "sine_with_dwell"):
        with pytest.raises(CanrollError, match="choose another --manoeuvre"):
            validate(log, car(), ValidationSettings(manoeuvre=name))


def test_several_manoeuvres_in_one_log_are_free_driving():
    one, two = columns("step_steer"), columns("sine_with_dwell")
    slower = np.interp(np.arange(1200), [0, 500, 700, 1200], [SPEED, 4.0, 4.0, SPEED])
    gap = {name: slower if name == "speed" else np.zeros(1200) for name in one}
    both = {name: np.concatenate((one[name], gap[name], two[name])) for name in one}
    both["steering"][450:600] *= np.linspace(1.0, 0.0, 150)
    both = driven(car(), both["steering"], both["speed"])
    drive = replayed(log_of(both), car(), Window(), "body", NONE)
    assert len(drive.stretches) == 2
    assert recognised(drive) == "free"


def test_limits_are_those_that_are_set():
    log, other = log_of(columns("free")), softer(CORNERING[0], share=0.97)
    assert validate(log, other, ValidationSettings()).passed
    assert not validate(log, other, ValidationSettings(rating=0.998)).passed
    assert not validate(log, other, ValidationSettings(error=0.005)).passed
    strict = {**ValidationSettings().explained, "roll": 0.9999}
    failed = validate(log, other, ValidationSettings(explained=strict)).failures
    assert len(failed) == 1
    assert failed[0].startswith("roll: ")


def test_tolerances_are_read_or_refused():
    chosen = with_choices({"circle.roll": "0.5:0.1", "time": "0.2"})
    assert chosen["circle.roll"].of(0.1) == pytest.approx(np.radians(0.5) + 0.01)
    assert (chosen["time"].offset, chosen["time"].gain) == (0.2, 0.0)
    assert chosen["peak"] == TOLERANCES["peak"]
    for text in ("x", "0.1:y", "-1:0", "0:0", "nan", "inf"):
        with pytest.raises(CanrollError, match=r"--tolerance time="):
            with_choices({"time": text})


def test_offsets_of_straight_driving_and_of_a_fit_are_taken_off(tmp_path):
    still = driven(car(), np.concatenate((np.zeros(150), free())), SPEED)
    offsets = {"yaw_rate": 0.05, "lateral_acceleration": 0.6, "roll": 0.02, "steering": 0.1}
    log = log_of({name: value + offsets.get(name, 0.0) for name, value in still.items()})
    assert not validate(log, car(), ValidationSettings()).passed
    zero = zeroed(log, Window(0.0, 1.4))
    assert zero.steering_offset == pytest.approx(0.1)
    assert zero.offsets["roll"] == pytest.approx(0.02, abs=1e-4)
    assert validate(log, car(), ValidationSettings(), zero).passed
    keys = {"log.steering_offset": 0.1, **{f"log.{k}_offset": v for k, v in offsets.items()}}
    keys["log.roll_delay"] = 0.03
    path = tmp_path / "fit.json"
    path.write_text(json.dumps({"numbers": [{"key": k, "value": v} for k, v in keys.items()]}))
    fitted = of_fit(path)
    assert fitted.delays == {"roll": 0.03}
    assert validate(log, car(), ValidationSettings(), Measurement(0.1, offsets)).passed


@pytest.mark.parametrize("text", ["", "{}", '{"numbers": [1]}', '{"numbers": []}'])
def test_a_file_that_is_no_fit_is_refused(tmp_path, text):
    path = tmp_path / "fit.json"
    path.write_text(text)
    with pytest.raises(CanrollError, match=r"fit\.json"):
        of_fit(path)


WITHOUT = [
    ("roll_rate", "roll", "sideslip"),
    ("lateral_acceleration", "roll_rate", "roll", "sideslip"),
    ("yaw_rate", "roll_rate", "roll", "sideslip"),
    ("yaw_rate", "lateral_acceleration"),
]


def without(manoeuvre, names):
    return log_of({k: v for k, v in columns(manoeuvre).items() if k not in names})


@pytest.mark.parametrize("manoeuvre", STEERINGS)
@pytest.mark.parametrize("missing", WITHOUT)
def test_a_car_is_judged_by_the_signals_that_are_there(manoeuvre, missing):
    log = without(manoeuvre, missing)
    result = validate(log, car(), ValidationSettings())
    assert result.passed
    assert {match.name for match in result.matches} == {*log.channels} - {"steering", "speed"}
    assert not validate(log, softer(CORNERING[1]), ValidationSettings()).passed
    assert "judged by" in headline([result])


def test_the_verdict_says_that_roll_was_not_judged():
    result = validate(without("free", WITHOUT[0]), car(), ValidationSettings())
    assert result.unjudged == ("roll rate",)
    assert headline([result]).endswith(
        ", judged by yaw rate and lateral acceleration, not by roll rate"
    )
    assert result.to_json()["not_judged"] == ["roll rate"]
    assert "roll rate was not judged" in headline([result, result])
    # the roll angle tells of roll too
    assert validate(without("free", ("roll_rate",)), car(), ValidationSettings()).unjudged == ()


def test_a_circle_needs_the_yaw_rate():
    log = without("steady_circle", ("yaw_rate",))
    with pytest.raises(CanrollError, match="it has no yaw rate"):
        validate(log, car(), ValidationSettings(manoeuvre="steady_circle"))


def test_a_log_without_motion_is_refused():
    still = driven(car(), np.zeros(400), SPEED)
    with pytest.raises(CanrollError, match="says nothing of the car"):
        validate(log_of(still), car(), ValidationSettings())


def test_a_car_that_rolls_over_where_the_measured_one_does_not_fails():
    narrow = car().replace({f"geometry.half_track_{axle}": 0.5 for axle in ("front", "rear")})
    with pytest.raises(VerdictError, match="rolls over where the measured car does not"):
        validate(log_of(driven(car(), ramp(1.8), SPEED)), narrow, ValidationSettings())


def test_the_verdict_as_json_has_plain_numbers():
    data = verdict("steady_circle").to_json()
    text = json.dumps(data, allow_nan=False)
    assert json.loads(text)["passed"] is True
    assert {band["name"] for band in data["bands"]} == {"steering", "sideslip", "roll"}
    assert inf not in [figure["tolerance"] for figure in data["figures"]]
