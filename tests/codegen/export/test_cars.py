"""The networks of twenty real cars: every map fits, is proved, and some of them are driven."""

import pytest
from support import cars

from canroll.codegen.generated.bus_map import load
from canroll.codegen.proof.prove import prove
from canroll.codegen.run.bus_firmware import of_bus
from canroll.codegen.run.native import compiler
from canroll.codegen.subset import rules

CARS = {car.name: car for car in cars.cars()}
SAMPLE = [
    pytest.param(name, marks=pytest.mark.long) if number % 5 else name
    for number, name in enumerate(CARS)
]


def test_there_are_twenty_cars_and_a_page_that_names_them():
    page = (cars.MAPS / "README.md").read_text(encoding="utf-8")
    assert len(CARS) == 20
    assert all(f"`{name}`" in page for name in CARS)


SIGNED_FROM_ZERO = ("hyundai_canfd", "subaru_global_2017")
"""Cars whose descriptions limit a signed signal to [0|255]."""


@pytest.mark.parametrize("name", CARS)
def test_the_map_of_a_car_fits_its_frames(name):
    car = CARS[name]
    bus = load((car.dbc, cars.ACTUATORS), car.map_file)
    fields = {signal.place.text for box in bus.received for signal in box.signals}
    assert fields >= {"speed", "steering", "lateral_acceleration", "delivered[0]"}
    defects = [text for text in bus.warnings if "its limits [0|255] in the description" in text]
    assert list(bus.warnings) == defects
    assert len(defects) == (name in SIGNED_FROM_ZERO)


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLE)
def test_the_firmware_of_a_car_is_proved(name):
    car = CARS[name]
    program = of_bus((car.dbc, cars.ACTUATORS), car.map_file).program()
    rules.check(program)
    assert not prove(program).findings


@pytest.mark.long
@pytest.mark.skipif(compiler() is None, reason="needs a C compiler (apt package gcc)")
@pytest.mark.parametrize(
    "name",
    [
        "hyundai_canfd",
        pytest.param("toyota_nodsu_pt", marks=pytest.mark.long),
        pytest.param("vw_pq", marks=pytest.mark.long),
    ],
)
def test_the_loop_on_a_car_works_and_its_bundle_tests_itself(name):
    car = CARS[name]
    alone, with_control = cars.roll_angles(car)
    assert with_control < alone
    chosen = cars.choices(car, load((car.dbc, cars.ACTUATORS), car.map_file))
    assert cars.bundle(car, chosen) == "ok"
