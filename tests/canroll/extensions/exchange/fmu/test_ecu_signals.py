"""The ECU's FMU with plain signals computes what the native firmware does with the same frames."""

import cantools
import numpy as np
import pytest
from support import float_bus
from support.fmus import importer

from canroll import dbc
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.run.backends import NativeEcu
from canroll.codegen.run.bus_firmware import built_in, of_bus
from canroll.codegen.run.ecu_traffic import random_calibration
from canroll.codegen.run.memory_image import sealed
from canroll.errors import CanrollError
from canroll.extensions.exchange.fmu import ecu, ecu_signals
from canroll.runs.experiment import plan

pytestmark = pytest.mark.slow

TICK = 10_000_000
SIZES = {
    "Imu": {"RollRate": 0.5, "LateralAcceleration": 5.0, "YawRate": 0.4},
    "VehicleMotion": {"VehicleSpeed": 25.0, "SteeringWheelAngle": 1.0},
    "ActuatorState": {"DeliveredMomentFront": 900.0, "DeliveredMomentRear": 700.0},
}
DEGREES = ("RollRate", "YawRate", "SteeringWheelAngle")


def on_the_bus(name, value):
    """A value in SI units in the DBC's."""
    if name in DEGREES:
        return np.degrees(value)
    return 3.6 * value if name == "VehicleSpeed" else value


def test_outputs_are_those_of_frames(tmp_path):
    # the values are random, so that no suspension bears the others out
    _, controller = plan("double_lane_change", response_watch=False)
    calibration = sealed(_without_protection(controller.record))
    path = tmp_path / "ecu.fmu"
    ecu.write(path, built_in(), calibration, title="ECU of a test", ports=ecu.SIGNALS)
    fmu = importer().Fmu(path)
    reference = NativeEcu(calibration)
    database = cantools.database.load_file(dbc.PATH)
    bus: BusMap = built_in().bus
    box = bus.transmitted[calibration.actuator]
    rng = np.random.default_rng(1)
    command = dict.fromkeys((s.name for s in box.signals), 0.0)
    largest = 0
    for k in range(1, 400):
        fmu.advance(k * TICK)
        for received in bus.received:
            message = database.get_message_by_name(received.name)
            data = {s.name: 0 for s in message.signals}
            for name, size in SIZES.get(received.name, {}).items():
                value = abs(size) if name == "VehicleSpeed" else size * np.sin(0.05 * k)
                value += 0.01 * size * rng.standard_normal()
                fmu.set(f"{received.name}.{name}", value)
                signal = message.get_signal_by_name(name)
                raw = np.floor(on_the_bus(name, value) / float(signal.scale) + 0.5)
                data[name] = raw * float(signal.scale)
            data["SampleCounter"] = k % 16
            if received.name == "ActuatorState":
                data["Enabled"] = 1
            payload = message.encode(data, strict=False)
            reference.receive(received.ident, np.frombuffer(payload, np.uint8), len(payload))
        sent = {ident: payload for ident, payload in reference.tick()}
        if box.ident in sent:
            command = database.decode_message(box.ident, sent[box.ident], decode_choices=False)
        fmu.advance((k + 1) * TICK)
        state = reference.state
        largest = max(largest, abs(state.moment))
        assert fmu.get("mode") == [state.mode]
        assert fmu.get("roll") == [state.x[0] / 2**30]
        assert fmu.get("moment") == [state.moment / 2**14]
        for signal in box.signals:
            assert fmu.get(f"{box.name}.{signal.name}") == [pytest.approx(command[signal.name])]
    assert reference.state.commands_sent > 50
    assert largest > 100 << 14


def _without_protection(calibration):
    copy = type(calibration)()
    for name, value in vars(calibration).items():
        setattr(copy, name, value)
    copy.e2e = 0
    return copy


def test_floating_point_numbers_are_refused_in_a_line(tmp_path):
    bus = of_bus(*float_bus.write(tmp_path)).bus
    with pytest.raises(CanrollError, match=r"GYRO_01.GY_\w+ .* floating-point .* --ports can"):
        ecu_signals.of_bus(bus, sealed(random_calibration(3)))
