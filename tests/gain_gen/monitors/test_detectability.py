"""The least sizes of faults, against residuals simulated tick by tick with such faults."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from canroll.gain_gen.models.task import Delay, Task
from canroll.gain_gen.monitors.bank import DERIVATIVE, INTEGRAL, STEP
from canroll.gain_gen.monitors.detectability import (
    FAULTS,
    TOLERATED,
    Limit,
    detectable,
    inseparable,
    isolated,
    slalom,
)
from canroll.gain_gen.monitors.residuals import bank_of
from canroll.gain_gen.monitors.uncertainty import Uncertainty
from canroll.vehicles import load

TICK = 0.01


def designed(name="van_real", actuator="bars"):
    task = Task(load(name), Delay.constant(0.02), tick=TICK, actuator=actuator)
    return task.vehicle, bank_of(task, Uncertainty(), suspension=True, moments=True)


class Part:
    """A part tick by tick, from its equations."""

    def __init__(self, part):
        self.part, self.memory, self.slow, self.value = part, 0.0, 0.0, 0.0
        self.wash = 2.0 * np.pi * part.washout * TICK
        self.low = TICK / part.low_pass

    def tick(self, signals):
        sample = sum(gain * signals.get(name, 0.0) for name, gain in self.part.gains.items())
        if self.part.kind == INTEGRAL:
            self.slow += self.low * (self.memory - self.slow)
            self.memory += TICK * sample - self.wash * self.memory
            self.value = self.slow
        elif self.part.kind != STEP:
            washed = self.memory + sample
            self.memory -= self.wash * washed
            self.slow += self.low * (washed - self.slow)
            self.value = washed - self.slow if self.part.kind == DERIVATIVE else self.slow


def raised(bank, residual, runs):
    """To which side a residual is beyond its threshold for its time in a run of signals, or 0."""
    parts = {term.part: Part(bank.parts[term.part]) for term in residual.terms}
    count = side = 0
    room = 0.0
    for signals in runs:
        for part in parts.values():
            part.tick(signals)
        left = sum(term.sign * parts[term.part].value for term in residual.terms)
        size = sum(term.weight * abs(parts[term.part].value) for term in residual.terms)
        room = max(size, room * np.exp(-TICK / residual.fading))
        now = int(np.sign(left)) if abs(left) > residual.floor + residual.noisy + room else 0
        count = count + 1 if now and now == side else abs(now)
        side = now
        if count * TICK >= residual.time - 1e-9:
            return side
    return 0


@pytest.mark.parametrize("name", ["van_real", "car_2020"])
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_on_a_straight_road_a_fault_above_its_limit_is_found_and_one_below_is_not(name, fault):
    vehicle, bank = designed(name, "suspension")
    limits = next(row.limits for row in detectable(bank, vehicle) if row.fault == fault)
    for limit in limits:
        residual = next(r for r in bank.residuals if r.name == limit.residual)
        longer = residual.time >= TOLERATED
        ticks = round((2.0 * residual.time if longer else TOLERATED) / TICK)
        for factor, expected in ((1.2, limit.side), (0.8, 0)):
            size = factor * limit.straight
            run = [{name: size * unit for name, unit in fault.signals.items()}] * ticks
            # one that takes longer goes on growing
            if expected or not longer:
                assert raised(bank, residual, run) == expected, limit


@pytest.mark.parametrize("fault", ["moment of the rear axle", "lateral acceleration", "roll rate"])
def test_in_the_slalom_a_fault_above_its_limit_is_found_whenever_it_begins(fault):
    vehicle, bank = designed()
    row = next(row for row in detectable(bank, vehicle) if row.fault.name == fault)
    limit = min(row.limits, key=lambda limit: limit.slalom)
    residual = next(r for r in bank.residuals if r.name == limit.residual)
    driven = slalom(vehicle, TICK)
    for begin in range(300, 550, 25):
        run = []
        for k in range(begin + 100):
            signals = {name: values[k] for name, values in driven.items()}
            if k >= begin:
                for name, unit in row.fault.signals.items():
                    signals[name] += 1.3 * limit.slalom * unit
            run.append(signals)
        assert raised(bank, residual, run[:begin]) == 0
        assert raised(bank, residual, run) == limit.side


@pytest.mark.parametrize("name", ["van_real", "suv_2020", "sedan_320i", "van_2021", "car_2020"])
def test_a_manoeuvre_hides_more_than_a_straight_road(name):
    vehicle, bank = designed(name, "suspension")
    rows = detectable(bank, vehicle)
    assert [row.fault for row in rows] == list(FAULTS)
    for row in rows:
        assert 0.0 < row.straight <= row.slalom <= row.isolated
        assert row.first in {residual.name for residual in bank.residuals}


def test_a_fault_of_a_signal_that_is_not_measured_is_not_in_the_table():
    task = Task(load("van_real"), Delay.constant(0.02), tick=TICK, actuator="bars")
    bank = bank_of(task, Uncertainty(), suspension=False, moments=True)
    assert [row.fault.name for row in detectable(bank, task.vehicle)] == ["lateral acceleration"]


def test_the_sides_of_two_residuals_tell_the_axles_apart():
    vehicle, bank = designed()
    rows = {row.fault.name: row for row in detectable(bank, vehicle)}
    sides = {
        (name, limit.residual): limit.side for name, row in rows.items() for limit in row.limits
    }
    front, rear = "moment of the front axle", "moment of the rear axle"
    assert sides[front, "body, fast"] == sides[front, "axles"]
    assert sides[rear, "body, fast"] == -sides[rear, "axles"]
    # what stroke rates say of an axle is what its moment does
    assert rows[front].inseparable == ("front stroke rate",)
    assert rows["roll rate"].inseparable == ()


def test_a_fault_is_told_apart_once_it_raises_what_no_other_does():
    limits = {
        "one": (Limit("a", 1, 1.0, 2.0), Limit("b", 1, 1.0, 5.0)),
        "other": (Limit("a", -1, 1.0, 3.0), Limit("b", 1, 1.0, 4.0)),
        "third": (Limit("c", 1, 1.0, 1.0),),
        "none": (),
    }
    # "a" alone is either, of some sign; with "b" it is one of them by the sides
    assert isolated("one", limits) == 5.0
    assert isolated("other", limits) == 4.0
    assert isolated("third", limits) == 1.0
    assert isolated("none", limits) == inf
    assert all(inseparable(name, limits) == () for name in limits)


def test_what_raises_the_same_residuals_is_never_told_apart():
    limits = {
        "one": (Limit("a", 1, 1.0, 2.0), Limit("b", 1, 1.0, 5.0)),
        "mirrored": (Limit("a", -1, 1.0, 8.0), Limit("b", -1, 1.0, 7.0)),
        "third": (Limit("a", 1, 1.0, 2.0),),
    }
    assert inseparable("one", limits) == ("mirrored",)
    assert isolated("one", limits) == 5.0
    assert isolated("third", limits) == inf


def test_beyond_its_limit_a_residual_finds_nothing():
    vehicle, bank = designed()
    gentle = replace(bank, residuals=tuple(replace(r, limit=3.9) for r in bank.residuals))
    for row, before in zip(detectable(gentle, vehicle), detectable(bank, vehicle), strict=True):
        assert row.straight == before.straight
        assert row.slalom == inf
        assert row.to_json()["slalom"] is None


def test_plain_data_has_no_infinities():
    vehicle, bank = designed()
    for row in detectable(bank, vehicle):
        data = row.to_json()
        assert data["fault"] == row.fault.name
        assert all(data[key] is None or data[key] < inf for key in ("straight", "slalom"))
