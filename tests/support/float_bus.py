"""The example of a user's bus with floating-point numbers where that has integers."""

import re
from pathlib import Path

OWN = Path(__file__).parents[2] / "examples" / "own_bus"
GYRO = """BO_ 257 GYRO_01: 8 InertialUnit
 SG_ GY_RollRate : 0|32@1- (1,0) [0|0] "deg/s" RollController
 SG_ GY_LateralAcceleration : 39|32@0- (1,0) [0|0] "g" RollController

BO_ 258 GYRO_02: 8 InertialUnit
 SG_ GY_YawRate : 5|32@1- (1,0) [0|0] "rad/s" RollController
"""
BAR = """BO_ 291 ROLL_BAR: 12 RollController
 SG_ RB_TorqueFront : 15|32@0- (1,0) [-8191|8191] "Nm" Dampers
 SG_ RB_TorqueRear : 64|32@1- (0.001,0) [-3.4E+38|3.4E+38] "kNm" Dampers
 SG_ RB_Mode : 48|4@1+ (1,0) [0|3] "" Dampers
"""
END = """BA_ "GenMsgCycleTime" BO_ 258 10;
SIG_VALTYPE_ 257 GY_RollRate : 1;
SIG_VALTYPE_ 257 GY_LateralAcceleration : 1;
SIG_VALTYPE_ 258 GY_YawRate : 1;
SIG_VALTYPE_ 291 RB_TorqueFront : 1;
SIG_VALTYPE_ 291 RB_TorqueRear : 1;
"""
IMU = """[[receive.imu]]
message = "GYRO_01"
signals.GY_RollRate = { field = "roll_rate", sign = -1 }
signals.GY_LateralAcceleration = "lateral_acceleration"
protection = { profile = "none" }

[[receive.imu]]
message = "GYRO_02"
signals.GY_YawRate = "yaw_rate"
protection = { profile = "none" }

"""


def write(folder: Path) -> tuple[Path, Path]:
    """Write the network and its map; return their paths."""
    text = (OWN / "own.dbc").read_text(encoding="utf-8")
    for name, message in (("GYRO_01", GYRO), ("ROLL_BAR", BAR)):
        text, count = re.subn(rf"BO_ \d+ {name}:.*\n(?: SG_ .*\n)*", message, text)
        assert count == 1
    table = (OWN / "own.toml").read_text(encoding="utf-8")
    start, end = table.index("[receive.imu]"), table.index("[receive.vehicle_motion]")
    table = table[:start] + IMU + table[end:]
    bar = 'message = "ROLL_BAR"\n'
    assert bar in table
    (folder / "float.dbc").write_text(f"{text.rstrip()}\n{END}", encoding="utf-8")
    (folder / "float.toml").write_text(table.replace(bar, f"{bar}fd = true\n"), encoding="utf-8")
    return folder / "float.dbc", folder / "float.toml"
