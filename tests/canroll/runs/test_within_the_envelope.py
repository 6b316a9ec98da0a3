"""The safety envelope leaves every shipped law alone, and stops what a law must not do."""

import re

import numpy as np
import pytest

from canroll.codegen.run import native
from canroll.codegen.run.backends import open_backend
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.subset.program import file_of
from canroll.errors import CanrollError
from canroll.firmware.plausibility import FAULT_ENVELOPE
from canroll.gain_gen.laws import LAWS
from canroll.runs.experiment import build_world, plan
from canroll.runs.virtual_time import closed_loop
from canroll.studies.severe import MANOEUVRES

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
KEPT = 1 << FAULT_ENVELOPE
BUSES = ("500k", "gateway_50ms")
LOOPS = [
    *(("van_real", "bars", law) for law in LAWS if law not in ("custom", "lqr_full_car")),
    *(("van_real", "suspension", law) for law in ("steering_lead", "hinf_delay", "lqg_delay")),
    ("suv_2020", "suspension", "smc"),
    ("suv_2020", "dampers", "lqr"),
    ("car_2020", "valves", "lqr_full_car"),
]
REFUSED = {
    ("van_real", "bars", "hinf_delay", "gateway_50ms"),
    ("van_real", "bars", "hinf_event", "gateway_50ms"),
    ("van_real", "suspension", "hinf_delay", "gateway_50ms"),
    ("car_2020", "valves", "lqr_full_car", "gateway_50ms"),
}
"""No gain helps at these delays."""
HARDEST = [MANOEUVRES[place] for place in (1, 7, 10)]
"""The fastest of each kind: a driver's lane change, a robot's reversal, a turn."""
FAST, SLOW = BUSES
ON_BOTH = [loop for loop in LOOPS if (*loop, SLOW) not in REFUSED]
SLOWEST = [(*loop, SLOW if loop in ON_BOTH else FAST) for loop in LOOPS]
"""Every loop on the slowest bus where it has a gain."""


@pytest.fixture(scope="module")
def without():
    """The firmware without its envelope."""
    source = file_of("ecu").read_text(encoding="utf-8")
    bare, count = re.subn(r"^    envelope\.\w+\(.*\)\n", "", source, flags=re.MULTILINE)
    assert count == 2
    return BusFirmware(
        built_in().bus,
        {"ecu.py": bare.replace("from canroll.firmware.monitors import envelope\n", "")},
    )


def driven(settings, controller, firmware, duration_ns=None):
    return closed_loop(
        build_world(settings, enabled=True),
        open_backend("native", controller.record, firmware),
        tick_ns=round(settings.tick * 1e9),
        duration_ns=duration_ns,
    )


def chosen(manoeuvre, vehicle, actuator, law, bus):
    return plan(
        manoeuvre.scenario,
        vehicle=vehicle,
        actuator=actuator,
        law=law,
        bus=bus,
        speed_kmh=manoeuvre.speed_kmh,
        options=dict(manoeuvre.options),
    )


def untouched(manoeuvres, loop, without):
    """Drive a loop; return in how many manoeuvres it had something to do."""
    seen = 0
    for manoeuvre in manoeuvres:
        settings, controller = chosen(manoeuvre, *loop)
        kept = driven(settings, controller, built_in())
        assert not np.any(kept.ticks["fault_codes"] & KEPT), manoeuvre.title
        assert not np.any(kept.signals["envelope"]), manoeuvre.title
        if manoeuvre in HARDEST:
            free = driven(settings, controller, without)
            assert kept.frames.tobytes() == free.frames.tobytes(), manoeuvre.title
        seen += np.abs(kept.ticks["moment"]).max() > 100
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("loop", SLOWEST, ids="-".join)
def test_no_law_is_touched_in_severe_manoeuvres(loop, without):
    assert untouched(MANOEUVRES, loop, without) > 6


@pytest.mark.slow
@pytest.mark.parametrize("loop", ON_BOTH, ids="-".join)
def test_nor_on_a_fast_bus_in_the_hardest(loop, without):
    assert untouched(HARDEST, (*loop, FAST), without) == len(HARDEST)


@pytest.mark.long
@pytest.mark.parametrize("loop", ON_BOTH, ids="-".join)
def test_nor_on_a_fast_bus_in_any(loop, without):
    assert untouched(MANOEUVRES, (*loop, FAST), without) > 6


@pytest.mark.parametrize("loop", sorted(REFUSED), ids="-".join)
def test_where_no_gain_helps_there_is_none(loop):
    with pytest.raises(CanrollError):
        chosen(HARDEST[0], *loop)
