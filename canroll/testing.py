"""Conformance tests for extensions to subclass in their test suites; all built-ins pass them.

A subclass names the object under test by entry-point name, "module:name" or "file.py:name";
pytest collects it by its class name::

    from canroll.testing import LawConformance

    class TestSkyhook(LawConformance):
        law = "skyhook"

The other attributes restrict the tests to one vehicle or supply options.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.models.task import Delay, Solution, Task
from canroll.plant_sim import can_bus
from canroll.plant_sim.bodies import BODIES, ports
from canroll.plant_sim.bodies.ports import Body, initial_inputs
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds
from canroll.plant_sim.can_bus.network.own_frames import own_messages
from canroll.plant_sim.can_bus.network.profiles import profile_spec
from canroll.plant_sim.driving import MANEUVERS, maneuvers
from canroll.plant_sim.driving.offered import check_plan
from canroll.plant_sim.world import open_loop
from canroll.runs import experiment
from canroll.setup.controller import COMMANDS
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle

SCENARIO = "double_lane_change"
VEHICLE = "van_real"


def is_one_line(error: CanrollError) -> bool:
    """Whether an error's message is one non-empty line."""
    return bool(str(error).strip()) and "\n" not in str(error)


class LawConformance:
    """A law can be designed, verified, converted to integers and driven.

    Attributes:
        law: its name.
        vehicle: vehicle it is designed for.
        actuator: actuator it commands.
        matrices: file of its gains, if it takes one.
    """

    law: str
    vehicle: str = VEHICLE
    actuator: str = "suspension"
    matrices: str = ""

    def tasks(self) -> Iterable[Task]:
        """Return tasks that need a verified design: short delay, varying delay, fast tick."""
        for delay, tick in (
            (Delay.constant(0.005), 0.01),
            (Delay(0.012, 0.007, 0.017), 0.01),
            (Delay.constant(0.012), 0.005),
        ):
            yield self._task(delay, tick)

    def _task(self, delay: Delay, tick: float = 0.01) -> Task:
        return Task(
            vehicle=vehicles.load(self.vehicle),
            delay=delay,
            tick=tick,
            actuator=self.actuator,
            matrices=self.matrices,
        )

    def test_it_says_what_it_is(self) -> None:
        """It has a docstring, whose first line ``canroll list laws`` shows."""
        assert LAWS.description(self.law), f"{self.law} has no docstring"

    def test_every_task_has_a_verified_design_that_the_ecu_takes(self, tmp_path: Path) -> None:
        """All checks hold for the real and the integer gains, and survive the calibration file."""
        for task in self.tasks():
            answer = design(self.law, task)
            assert not answer.failures
            record, tables = calibrate(answer)
            file = tmp_path / "calibration.toml"
            calibration_file.save(file, record, tables)
            loaded = calibration_file.load(file)
            assert loaded.law == self.law
            assert loaded.record.id == record.id

    def test_the_same_task_has_the_same_gains(self) -> None:
        """The gains depend on nothing random and on no earlier call."""
        first, second = (LAWS[self.law](next(iter(self.tasks()))) for _ in range(2))
        assert _gains(first) == _gains(second)

    def test_the_task_is_left_alone(self) -> None:
        """The task is shared with later designs and must not be modified."""
        task = next(iter(self.tasks()))
        before = repr(task)
        LAWS[self.law](task)
        assert repr(task) == before

    def test_what_cannot_be_is_refused_in_one_line(self) -> None:
        """A delay of 0.3 s: a verified design or a refusal, nothing else."""
        try:
            answer = design(self.law, self._task(Delay.constant(0.3)))
        except CanrollError as refused:
            assert is_one_line(refused)
        else:
            assert not answer.failures

    def test_it_makes_the_car_roll_less(self) -> None:
        """In a double lane change, over the bus and with sensor noise."""
        if not self.matrices:
            result = experiment.run(
                SCENARIO, law=self.law, vehicle=self.vehicle, actuator=self.actuator, duration=4.0
            )
            assert result.controlled_metrics is not None
            passive, controlled = result.passive_metrics, result.controlled_metrics
            assert controlled.roll_rms_deg < passive.roll_rms_deg


def _gains(solution: Solution) -> list[bytes]:
    """Return the exact bytes of a controller's numbers."""
    controller = solution.controller
    parts = [controller.feedback, controller.feedforward, controller.observer.correction]
    if controller.output_gain is not None:
        parts.append(controller.output_gain)
    inner = controller.compensator
    if inner is not None:
        parts += [inner.a, inner.b, inner.c, inner.d, inner.e]
    return [np.asarray(part, dtype=float).tobytes() for part in parts]


class BodyConformance:
    """A body obeys the sign conventions and physics that the nodes around it rely on.

    Attributes:
        body: its name.
        vehicles: vehicles it can represent.
        speed: speed of the tests, m/s.
    """

    body: str
    vehicles: Sequence[str] = vehicles.names()
    speed: float = 20.0
    step: ClassVar[float] = 1e-3

    def drive(
        self, vehicle: Vehicle, seconds: float, *, step: float = 1e-3, **slots: float
    ) -> tuple[Vector, Vector]:
        """Return state and outputs after ``seconds`` of constant inputs, by name in ``ports``."""
        body = BODIES[self.body]
        state, parameters = body.build(vehicle, self.speed)
        inputs, outputs = initial_inputs(), np.zeros(ports.N_OUTPUTS)
        for name, value in slots.items():
            inputs[getattr(ports, name)] = value
        before = parameters.copy()
        for _ in range(round(seconds / step)):
            open_loop.advance(body.step, state, inputs, parameters, outputs, step)
        assert np.array_equal(parameters, before), "the step changes the parameters"
        return state, outputs

    def each(self) -> Iterable[Vehicle]:
        """Return the vehicles."""
        return (vehicles.load(name) for name in self.vehicles)

    def test_it_says_what_it_is(self) -> None:
        """It has a description for ``canroll list bodies``."""
        assert isinstance(BODIES[self.body], Body)
        assert BODIES.description(self.body), f"{self.body} has no string below it"

    def test_it_stands_on_four_wheels_with_its_weight(self) -> None:
        """A zero-length step fills the outputs and leaves the state unchanged."""
        for vehicle in self.each():
            body = BODIES[self.body]
            state, parameters = body.build(vehicle, self.speed)
            before, outputs = state.copy(), np.zeros(ports.N_OUTPUTS)
            open_loop.advance(body.step, state, initial_inputs(), parameters, outputs, 0.0)
            assert np.array_equal(state, before)
            loads = outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
            assert np.all(loads > 0.0)
            assert abs(loads.sum() / (vehicle.total_mass * GRAVITY) - 1.0) < 1e-6
            assert abs(outputs[ports.VX] - self.speed) < 1e-9

    def test_it_goes_straight_on(self) -> None:
        """Without steering it neither turns nor rolls, and travels speed times time."""
        for vehicle in self.each():
            _, outputs = self.drive(vehicle, 1.0)
            assert abs(outputs[ports.X] / self.speed - 1.0) < 0.05
            for slot in (ports.Y, ports.YAW, ports.AY, ports.ROLL):
                assert abs(outputs[slot]) < 1e-6

    def test_left_is_left(self) -> None:
        """Steered left, it turns left, the body leans outwards and the right wheels carry more."""
        for vehicle in self.each():
            _, outputs = self.drive(vehicle, 1.0, STEER=0.01)
            assert outputs[ports.YAW_RATE] > 0.0
            assert outputs[ports.AY] > 0.0
            assert outputs[ports.ROLL] > 0.0
            left, right = (outputs[ports.WHEEL_LOAD + side :: 2][:2] for side in (0, 1))
            assert right.sum() > left.sum()

    def test_right_is_left_in_a_mirror(self) -> None:
        """Mirroring the steering changes only signs."""
        for vehicle in self.each():
            (_, left), (_, right) = (self.drive(vehicle, 1.0, STEER=s * 0.01) for s in (1, -1))
            for slot in (ports.Y, ports.YAW_RATE, ports.AY, ports.ROLL, ports.ROLL_RATE):
                assert abs(left[slot] + right[slot]) <= 1e-6 * max(1.0, abs(left[slot]))

    def test_forces_up_on_the_left_lift_the_left(self) -> None:
        """The actuators' forces at the corners reach the body with the right sign."""
        for vehicle in self.each():
            corners = {"CORNER_FORCE": 500.0}
            _, outputs = self.drive(vehicle, 0.5, **corners)
            assert outputs[ports.ROLL] > 0.0

    def test_the_same_inputs_have_the_same_outputs(self) -> None:
        """Repeated bit for bit: there is no hidden state."""
        for vehicle in self.each():
            first, second = (self.drive(vehicle, 0.5, STEER=0.01)[1] for _ in range(2))
            assert first.tobytes() == second.tobytes()

    def test_half_the_step_gives_the_same_roll(self) -> None:
        """The integration step of 1 ms is short enough."""
        for vehicle in self.each():
            full, half = (
                self.drive(vehicle, 1.0, step=step, STEER=0.01)[1][ports.ROLL]
                for step in (self.step, self.step / 2)
            )
            assert abs(full - half) < 0.01 * abs(half)

    def test_it_is_driven_under_control(self) -> None:
        """In a double lane change with sensors, bus and controller, every signal stays finite."""
        result = experiment.run(SCENARIO, plant=self.body, duration=3.0)
        assert result.controlled is not None
        for trace in (result.passive, result.controlled):
            for name, values in trace.signals.items():
                assert np.isfinite(values).all(), name


class ManoeuvreConformance:
    """A manoeuvre can be planned for every vehicle and driven.

    Attributes:
        scenario: its name.
        options: options it requires.
        vehicles: vehicles it is driven with.
        plant: body it is driven on.
    """

    scenario: str
    options: Mapping[str, Any] = {}
    vehicles: Sequence[str] = vehicles.names()
    plant: str = "roll1"

    def build(self, vehicle: str, speed: float | None = None, seed: int = 0) -> maneuvers.Maneuver:
        """Return the prepared manoeuvre."""
        loaded = vehicles.load(vehicle)
        return maneuvers.build(self.scenario, loaded, speed, seed, **self.options)

    def test_it_says_what_it_is(self) -> None:
        """It has a description for ``canroll list scenarios`` and a title for reports."""
        assert MANEUVERS.description(self.scenario), f"{self.scenario} has no string below it"
        assert maneuvers.title(self.scenario)

    def test_it_is_planned_at_all_its_speeds(self) -> None:
        """The plan is drivable for every vehicle."""
        fastest = maneuvers.speed_range(self.scenario)[1]
        own = maneuvers.options(self.scenario)
        plain = {name: own[name] for name in own if name not in COMMON} | dict(self.options)
        for name in self.vehicles:
            vehicle = vehicles.load(name)
            usual = maneuvers.default_speed(self.scenario, vehicle)
            for speed in (usual, 0.5 * (usual + fastest), fastest):
                check_plan(MANEUVERS[self.scenario].plan(vehicle, speed, 0, **plain))
                assert self.build(name, speed).speed == speed

    def test_the_same_seed_is_the_same_manoeuvre(self) -> None:
        """Everything random in it comes from the seed alone."""
        for name in self.vehicles:
            first, second = (self.build(name, seed=3) for _ in range(2))
            assert first.duration_ns == second.duration_ns
            for one, other in zip(first.drive, second.drive, strict=True):
                assert np.asarray(one).tobytes() == np.asarray(other).tobytes()

    def test_faster_than_possible_is_refused_in_one_line(self) -> None:
        """Speeds above its fastest and unknown options are refused."""
        fastest = maneuvers.speed_range(self.scenario)[1]
        for speed, more in ((2.0 * fastest, {}), (None, {"no_such_option": 1})):
            try:
                vehicle = vehicles.load(self.vehicles[0])
                maneuvers.build(self.scenario, vehicle, speed, 0, **{**self.options, **more})
            except CanrollError as refused:
                assert is_one_line(refused)
            else:
                raise AssertionError(f"{speed} m/s, {more}: not refused")

    def test_it_is_driven_to_its_end(self) -> None:
        """Every output of the body stays finite, and the car moves forward."""
        for name in self.vehicles:
            outputs, steer = open_loop.run_passive(
                vehicles.load(name), BODIES[self.plant], self.build(name)
            )
            assert np.isfinite(outputs).all()
            assert np.isfinite(steer).all()
            assert outputs[-1, ports.X] != 0.0


COMMON = ("friction", "chassis_control", "preview_time", "road")
"""Options that every manoeuvre has, of road and driver."""


class BusConformance:
    """A bus carries every controller's traffic, with the stated load and within its bounds.

    Attributes:
        bus: its name.
        seconds: simulated time, s.
    """

    bus: str
    seconds: float = 3.0

    def test_it_says_what_it_is(self) -> None:
        """It has a description for ``canroll list buses``."""
        assert BUSES.description(self.bus), f"{self.bus} has no string below it"

    def test_every_command_arrives_in_bounded_time(self) -> None:
        """The worst-case analysis converges for all actuators."""
        profile = BUSES[self.bus]
        for command in COMMANDS.values():
            bounds = delay_bounds(profile, tick_ms=10.0, command=command)
            assert 0.0 < bounds.age_min <= bounds.age_max < 1.0

    def test_simulated_ages_are_within_the_bounds(self) -> None:
        """Simulated delays stay within those the controller is designed for."""
        result = experiment.run(SCENARIO, bus=self.bus, duration=self.seconds)
        assert result.controlled is not None
        ages = 1e-9 * result.controlled.ages
        assert len(ages) > 0
        assert ages.max() <= result.delay.most
        assert ages.min() >= 0.0

    def test_the_load_is_what_it_says(self) -> None:
        """The load of control and background traffic together is as stated on every segment."""
        profile = BUSES[self.bus]
        spec = profile_spec(profile, seed=1)
        own = tuple(message.source() for message in own_messages(profile=profile))
        network = can_bus.build_network(replace(spec, sources=(*spec.sources, *own)))
        can_bus.advance(network, round(self.seconds * 1e9))
        for segment in range(profile.segments):
            assert abs(can_bus.load(network, segment) - profile.load) < 0.03
            assert can_bus.account(network, segment).balanced

    def test_the_same_seed_has_the_same_frames(self) -> None:
        """Repeated bit for bit, whatever ran before."""
        first, second = (
            experiment.run(SCENARIO, bus=self.bus, law="passive", seed=4, duration=1.0)
            for _ in range(2)
        )
        assert first.passive.frames.tobytes() == second.passive.frames.tobytes()
