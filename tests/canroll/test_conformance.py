"""Everything that is built in passes the tests that an extension's own suite subclasses."""

import pytest

from canroll import testing
from canroll.gain_gen.laws import LAWS
from canroll.plant_sim.bodies import BODIES
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.driving import MANEUVERS

NEEDS = {"lqr_full_car": {"vehicle": "car_2020", "actuator": "valves"}}


SLOW = pytest.mark.slow
BUS = "500k"
OTHERS = [bus for bus in BUSES if bus != BUS]
QUICK = ("steering_lead", "lqr", "hinf_delay", "hinf_event", "lqr_full_car", "custom")
"""A law of each kind."""


class TestLaws(testing.LawConformance):
    @pytest.fixture(
        autouse=True, params=[n if n in QUICK else pytest.param(n, marks=SLOW) for n in LAWS]
    )
    def each(self, request, tmp_path):
        self.law = request.param
        for name, value in NEEDS.get(self.law, {}).items():
            setattr(self, name, value)
        if self.law == "custom":
            gains = tmp_path / "gains.toml"
            gains.write_text("K = [[20000.0, 6000.0]]\n")
            self.matrices = str(gains)


class TestBodies(testing.BodyConformance):
    @pytest.fixture(autouse=True, params=list(BODIES))
    def each_body(self, request):
        self.body = request.param


BEYOND_ROLL1 = (
    *("braking_in_curve", "power_off_in_curve"),
    *("crosswind", "split_friction", "friction_jump"),
)
"""Manoeuvres for a car with tyres: roll1 keeps its speed, and no wind or friction moves it."""


class TestManoeuvres(testing.ManoeuvreConformance):
    @pytest.fixture(autouse=True, params=list(MANEUVERS))
    def each(self, request, tmp_path):
        self.scenario = request.param
        if self.scenario == "from_file":
            signal = tmp_path / "signal.csv"
            signal.write_text("time,steering_wheel_deg\n0,0\n1,20\n2,20\n3,0\n")
            self.options = {"file": str(signal)}
        if self.scenario in BEYOND_ROLL1:
            self.plant = "nonlinear"


class TestBuses(testing.BusConformance):
    @pytest.fixture(autouse=True, params=[BUS, *(pytest.param(b, marks=SLOW) for b in OTHERS)])
    def each(self, request):
        self.bus = request.param
