"""How many frames that the ECU takes a bus can carry."""

import pytest

from canroll import dbc
from canroll.codegen.generated.bus_map import load
from canroll.codegen.generated.signals import DBC, MAP
from canroll.plant_sim.buses.profile import BUSY, QUICK, SECURED
from canroll.plant_sim.can_bus.network.own_frames import most_received

SHORTEST = {"secured_fd": 157_000, "500k": 222_000, "125k_busy": 888_000}
"""A frame without a stuff bit, ns: 29 bits at 500 kbit/s and 198 at 2 Mbit/s; 111 if classic."""


@pytest.mark.parametrize("profile", [SECURED, QUICK, BUSY], ids=lambda its: its.name)
def test_a_full_bus_carries_its_shortest_frame_over_and_over(profile):
    secured = profile is SECURED
    bus = load(dbc.SECURED_PATH, dbc.SECURED_MAP) if secured else load(DBC, MAP)
    shortest = SHORTEST[profile.name]
    assert most_received(profile, bus, 1) == 1
    assert most_received(profile, bus, shortest) == 1
    assert most_received(profile, bus, shortest + 1) == 2
    assert most_received(profile, bus, 50 * shortest) == 50


def test_a_tick_of_10_ms_sees_64_authenticated_frames_at_most():
    assert most_received(SECURED, load(dbc.SECURED_PATH, dbc.SECURED_MAP), 10_000_000) == 64
