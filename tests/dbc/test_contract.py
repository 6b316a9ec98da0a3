"""What others take from the contract: one vocabulary, no copy by hand."""

from math import floor

import pytest

import dbc
from firmware import plausibility, state
from firmware.calibration import Calibration
from firmware.subset import fields
from hil.runs.choices import CHOICES

LIMITS = {field.name: field.f.hi for field in fields(Calibration)}


@pytest.mark.parametrize(
    ("field", "message", "signal"),
    [
        ("force_max", "SuspensionForceCommand", "ForceFrontLeft"),
        ("bar_max", "AntiRollBarCommand", "TorqueFront"),
        ("current_max", "ValveCommand", "CurrentFront"),
    ],
)
def test_no_command_is_larger_than_its_frame_can_carry(field, message, signal):
    assert LIMITS[field] == floor(dbc.largest(message, signal)) << 14


@pytest.mark.parametrize("message", ["SuspensionForceCommand", "RollControlStatus"])
def test_modes_are_numbered_as_the_firmware_has_them(message):
    modes = dbc.names(message, "Mode")
    assert [getattr(state, name) for name in modes] == list(range(len(modes)))


def test_the_default_heartbeat_is_the_cycle_of_the_command():
    assert CHOICES["heartbeat_ms"].default == 1e3 * dbc.period("SuspensionForceCommand")


def test_every_fault_code_has_a_place_in_the_diagnostics():
    """Codes 0 to 4 are messages that are late; the others are the firmware's own."""
    codes = [number for name, number in vars(plausibility).items() if name.startswith("TROUBLE_")]
    assert len(set(codes)) == len(codes)
    assert max(codes) < dbc.message("RollControlDiagnostics").length * 8
