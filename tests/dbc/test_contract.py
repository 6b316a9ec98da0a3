"""What others take from the contract: one vocabulary, no copy by hand."""

from math import floor

import cantools
import pytest

from canroll import dbc
from canroll.firmware import calibration, plausibility, state
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields
from canroll.setup.choices import CHOICES

LIMITS = {field.name: field.f.hi for field in fields(Calibration)}
COMMANDS = {field.name: (field.f.lo, field.f.hi) for field in fields(state.Ecu)}
LAWS = ("STATE_FEEDBACK", "OUTPUT_FEEDBACK", "COMPENSATOR")
CORNERS = ("FrontLeft", "FrontRight", "RearLeft", "RearRight")


@pytest.mark.parametrize(
    ("field", "message", "signal"),
    [
        ("force", "SuspensionForceCommand", "ForceFrontLeft"),
        ("bar", "AntiRollBarCommand", "TorqueFront"),
        ("current", "ValveCommand", "CurrentFront"),
    ],
)
def test_no_command_is_larger_than_its_frame_can_carry(field, message, signal):
    largest = floor(dbc.largest(message, signal)) << 14
    assert LIMITS[f"{field}_max"] == largest
    assert COMMANDS[field] == (-largest, largest)


@pytest.mark.parametrize("message", ["SuspensionForceCommand", "RollControlStatus"])
def test_modes_are_numbered_as_the_firmware_has_them(message):
    modes = dbc.names(message, "Mode")
    assert [getattr(state, name) for name in modes] == list(range(len(modes)))


def test_laws_are_numbered_as_the_firmware_has_them():
    written = [name.upper() for name in dbc.names("RollControlStatus", "Law")]
    assert written == [name.replace("_", "") for name in LAWS]
    assert [getattr(calibration, name) for name in LAWS] == list(range(len(LAWS)))


@pytest.mark.parametrize("corner", CORNERS)
def test_states_of_a_corner_are_numbered_as_the_firmware_has_them(corner):
    states = dbc.names("ActuatorState", f"Status{corner}")
    assert states.index("STUCK") == plausibility.STUCK
    assert states.index("FLOATING") == plausibility.FLOATING


def test_the_default_heartbeat_is_the_cycle_of_the_command():
    assert CHOICES["heartbeat_ms"].default == 1e3 * dbc.period("SuspensionForceCommand")


def test_every_fault_code_has_a_place_in_the_diagnostics():
    """Codes 0 to 4 are messages that are late; the others are the firmware's own."""
    codes = [number for name, number in vars(plausibility).items() if name.startswith("FAULT_")]
    assert len(set(codes)) == len(codes)
    assert max(codes) < state.N_FAULT_CODES
    shown = dbc.message("RollControlDiagnostics").get_signal_by_name("ActiveFaultCodes")
    assert shown.length == state.N_FAULT_CODES


def test_the_fd_contract_says_the_same_in_other_frames():
    """Every frame but the sensors' is the classic one; the cluster has the sensors' signals."""
    fd = cantools.database.load_file(dbc.PATH.with_name("roll_control_fd.dbc"))
    cluster = fd.get_message_by_name("SensorCluster")
    merged = ("Imu", "VehicleMotion", "SuspensionRate", "SuspensionTravel")
    for message in dbc.load().messages:
        of_fd = cluster if message.name in merged else fd.get_message_by_name(message.name)
        assert of_fd.is_fd
        for signal in message.signals:
            if of_fd is cluster and signal.name in ("Checksum", "Counter", "SampleCounter"):
                continue
            its = of_fd.get_signal_by_name(signal.name)
            assert (its.length, its.is_signed, its.scale, its.offset, its.unit, its.choices) == (
                signal.length,
                signal.is_signed,
                signal.scale,
                signal.offset,
                signal.unit,
                signal.choices,
            )
            if of_fd is not cluster:
                assert (its.start, of_fd.frame_id, dbc.data_id(of_fd)) == (
                    signal.start,
                    message.frame_id,
                    dbc.data_id(message),
                )
    covered = {s.name for name in merged for s in dbc.message(name).signals}
    assert {signal.name for signal in cluster.signals} == covered


@pytest.mark.parametrize(("length", "on_the_wire"), [(8, 8), (9, 12), (29, 32), (33, 48), (64, 64)])
def test_a_fd_frame_is_padded_to_the_next_length_code(length, on_the_wire):
    assert dbc.padded(length) == on_the_wire
