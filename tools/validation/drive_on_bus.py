"""A measured drive as a bus log: what the sensors of a car would have sent to the ECU.

``python -m tools.validation.drive_on_bus FOLDER`` writes the drive of examples/bmw_m8 as
``drive.blf`` with its description ``car.dbc`` and its map ``car.toml``, so that the firmware can be
driven with it: ``canroll ecu --replay drive.blf --dbc car.dbc --map car.toml --calibration FILE``.

With a second argument, the ``fit.json`` of ``canroll fit`` on this drive, offsets and delays of the
signals are taken out that the fit knows.

The car had no actuator: its messages state a delivered moment of zero. The levelled acceleration of
the log becomes that along the body, as the ECU's sensor reads it: a_y cos φ + g sin φ.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path

import can
import cantools
import numpy as np

from tools.validation.measured_car import EXAMPLE
from vehicles import GRAVITY

CYCLE = 0.01
"""Cycle time of all messages (s)."""
FASTEST = 100.0 / 3.6
"""m/s; faster rows are no speed."""
DBC = """VERSION ""

BU_: RollController Car

BO_ 257 BODY: 8 Car
 SG_ RollRate : 0|16@1- (0.005,0) [-163|163] "deg/s" RollController
 SG_ YawRate : 16|16@1- (0.005,0) [-163|163] "deg/s" RollController
 SG_ LateralAcceleration : 32|16@1- (0.001,0) [-32|32] "m/s2" RollController

BO_ 258 MOTION: 8 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|655] "km/h" RollController
 SG_ Steering : 16|16@1- (0.1,0) [-3276|3276] "deg" RollController
 SG_ Alive : 48|4@1+ (1,0) [0|15] "" RollController

BO_ 259 ACTUATORS: 8 Car
 SG_ Front : 0|16@1- (0.5,0) [-16380|16380] "Nm" RollController
 SG_ Rear : 16|16@1- (0.5,0) [-16380|16380] "Nm" RollController
 SG_ Enabled : 40|1@1+ (1,0) [0|1] "" RollController
 SG_ Held : 41|1@1+ (1,0) [0|1] "" RollController
 SG_ Sample : 48|4@1+ (1,0) [0|15] "" RollController

BO_ 291 ROLL_BAR: 8 RollController
 SG_ TorqueFront : 0|16@1- (0.25,0) [-8191|8191] "Nm" Car
 SG_ TorqueRear : 16|16@1- (0.25,0) [-8191|8191] "Nm" Car
 SG_ Mode : 32|4@1+ (1,0) [0|3] "" Car

BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 257 10;
BA_ "GenMsgCycleTime" BO_ 258 10;
BA_ "GenMsgCycleTime" BO_ 259 10;
BA_ "GenMsgCycleTime" BO_ 291 10;
"""
MAP = """schema = 1

[receive.imu]
message = "BODY"
signals.RollRate = "roll_rate"
signals.YawRate = "yaw_rate"
signals.LateralAcceleration = "lateral_acceleration"
protection = { profile = "none" }

[receive.vehicle_motion]
message = "MOTION"
signals.Speed = "speed"
signals.Steering = "steering"
signals.Alive = "motion_sample"
protection = { profile = "none" }

[receive.actuator_state]
message = "ACTUATORS"
signals.Front = "delivered[0]"
signals.Rear = "delivered[1]"
signals.Enabled = "enabled"
signals.Held = "command_held"
signals.Sample = "actuator_sample"
protection = { profile = "none" }

[transmit.anti_roll_bar]
message = "ROLL_BAR"
signals.TorqueFront = "bar[0]"
signals.TorqueRear = "bar[1]"
signals.Mode = "mode"
protection = { profile = "none" }
"""


def write(folder: Path, known: Mapping[str, float]) -> None:
    """Write log, description and map into ``folder``.

    Args:
        folder: made where there is none.
        known: offsets (SI) and delays (s) of the measurement by key, as "log.roll_rate_delay".
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "car.dbc").write_text(DBC)
    (folder / "car.toml").write_text(MAP)
    rows = np.genfromtxt(EXAMPLE / "double_lane_change.csv", delimiter=",", names=True)
    database = cantools.database.load_string(DBC, "dbc")
    stamps, unique = np.unique(rows["time_s"], return_index=True)
    time = np.arange(0.0, stamps[-1], CYCLE)

    def at(column: str, quantity: str) -> np.ndarray:
        moved = time + known.get(f"log.{quantity}_delay", 0.0)
        measured = np.interp(moved, stamps, rows[column][unique])
        return np.asarray(measured - known.get(f"log.{quantity}_offset", 0.0))

    roll = at("roll_rad", "roll")
    lateral = at("ay_m_s2", "lateral_acceleration")
    degrees = np.degrees(1.0)
    signals = {
        "RollRate": degrees * at("roll_rate_rad_s", "roll_rate"),
        "YawRate": degrees * at("yaw_rate_rad_s", "yaw_rate"),
        "LateralAcceleration": lateral * np.cos(roll) + GRAVITY * np.sin(roll),
        "Speed": 3.6 * np.clip(at("speed_m_s", "speed"), 0.0, FASTEST),
        "Steering": degrees * at("steering_wheel_rad", "steering"),
    }
    constant = {"Front": 0.0, "Rear": 0.0, "Enabled": 1, "Held": 0}
    with can.BLFWriter(str(folder / "drive.blf")) as log:
        for i in range(len(time)):
            values = constant | {name: float(column[i]) for name, column in signals.items()}
            values |= {"Alive": i % 15, "Sample": i % 15}
            for message in database.messages:
                if "Car" not in message.senders:
                    continue
                data = message.encode({s.name: values[s.name] for s in message.signals})
                stamp = float(time[i]) + 2e-4 * (message.frame_id - 256)
                log(
                    can.Message(
                        timestamp=stamp,
                        arbitration_id=message.frame_id,
                        is_extended_id=False,
                        data=data,
                    )
                )


if __name__ == "__main__":
    numbers = json.loads(Path(sys.argv[2]).read_text())["numbers"] if sys.argv[2:] else []
    write(Path(sys.argv[1]), {number["key"]: number["value"] for number in numbers})
