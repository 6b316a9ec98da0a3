"""Public DBCs of real cars: the loop's codec on their frames is what cantools says.

The files are those of the package opendbc (``pip install --no-deps opendbc``).
"""

from pathlib import Path

import pytest
from support.bundles import compared, export, make

from canroll.codegen.export import bundle, coverage_cases, figures
from canroll.codegen.generated import bus_map
from canroll.codegen.run import ecu_traffic, memory_image, native

REPAIRED = ("vw_meb", "mazda_2017")
ITSELF = ("vw_meb",)
"""Its bundle runs its own tests too; what they run of the others is the same loop."""
SHORT = ("vw_mqb",)
"""Overlapping signals, signs of their own; the others before a release."""
WITH_DEFECTS = ("vw_mqb", *REPAIRED)
CARS = {
    # overlapping signals, units that no other maker writes, signs in bits of their own
    "vw_mqb": """schema = 1
[receive.imu]
message = "ESP_02"
signals.ESP_Querbeschleunigung = "lateral_acceleration"
signals.ESP_Gierrate = { field = "yaw_rate", sign = "ESP_VZ_Gierrate", unavailable = [16383] }
[receive.vehicle_motion]
message = "LWI_01"
signals.LWI_Lenkradwinkel = { field = "steering", sign = "LWI_VZ_Lenkradwinkel" }
[transmit.status]
message = "ESP_21"
signals.ESP_v_Signal = "speed"
""",
    # identifiers of 29 bits without their bit, a frame of 48 bytes without its format
    "vw_meb": """schema = 1
[receive.imu]
message = "ESC_50"
fd = true
period_ms = 20
signals.Lateral_Accel = "lateral_acceleration"
signals.Yaw_Rate = { field = "yaw_rate", sign = "Yaw_Rate_Sign" }
[receive.vehicle_motion]
message = "LWI_01"
signals.LWI_Lenkradwinkel = { field = "steering", sign = "LWI_VZ_Lenkradwinkel" }
[transmit.status]
message = "SAL_01"
id = 0x12DD54CA
signals.CNT = "mode"
""",
    # names that begin with a digit, value tables of absent signals
    "mazda_2017": """schema = 1
[receive.vehicle_motion]
message = "_2017_5"
signals.counter = { field = "speed", unit = "km/h", factor = 8 }
[transmit.status]
message = "NEW_MSG_12"
signals.NEW_SIGNAL_1 = "mode"
""",
    # big-endian, rad/s with an offset, a counter and a checksum that stay unmapped
    "ford_lincoln_base_pt": """schema = 1
[receive.imu]
message = "Yaw_Data_FD1"
signals.VehRol_W_Actl = { field = "roll_rate", unavailable = [65534, 65535] }
signals.VehYaw_W_Actl = { field = "yaw_rate", sign = -1 }
[receive.vehicle_motion]
message = "BrakeSysFeatures"
signals.Veh_V_ActlBrk = "speed"
""",
    # an angle in steps of 1.5 degrees, and the rest of it
    "toyota_prius_2010_pt": """schema = 1
[receive.vehicle_motion]
message = "STEER_ANGLE_SENSOR"
signals.STEER_ANGLE = "steering"
signals.STEER_FRACTION = { field = "steering", add = true }
[transmit.status]
message = "SPEED"
signals.SPEED = "speed"
""",
    # frames of five bytes, a signal without a unit
    "hyundai_2015_ccan": """schema = 1
[receive.imu]
message = "ESP12"
signals.LAT_ACCEL = "lateral_acceleration"
signals.YAW_RATE = { field = "yaw_rate", unit = "deg/s" }
[receive.vehicle_motion]
message = "SAS11"
signals.SAS_Angle = "steering"
""",
}


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize(
    "car", [car if car in SHORT else pytest.param(car, marks=pytest.mark.long) for car in CARS]
)
def test_a_real_cars_frames_are_read_as_cantools_reads_them(car, tmp_path, monkeypatch):
    opendbc = pytest.importorskip("opendbc", reason="needs the package opendbc (--no-deps)")
    dbc = Path(opendbc.__file__).parent / "dbc" / f"{car}.dbc"
    map_file = tmp_path / "map.toml"
    map_file.write_text(CARS[car])
    bus = bus_map.load(dbc, map_file)
    assert bool(bus.warnings) == (car in WITH_DEFECTS)
    record = ecu_traffic.random_calibration(3)
    record.e2e = 0
    memory_image.sealed(record)
    if car not in ITSELF:
        # only the codec of the bundle is run
        monkeypatch.setattr(coverage_cases, "general", lambda firmware: "")
        monkeypatch.setattr(figures, "table", lambda *_: "")
    folder = tmp_path / "bundle"
    bundle.write(folder, export(record, dbc=dbc, map_file=map_file))
    as_it_is = (folder / dbc.name).read_bytes() == dbc.read_bytes()
    assert as_it_is == (car not in REPAIRED)
    if car in ITSELF:
        done = make(folder, "test", "CFLAGS=-std=c99 -O1 -Wall -Werror")
        assert done.returncode == 0, done.stdout + done.stderr
    result = compared(folder, 2000)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "FAIL" not in result.stdout and result.stdout.count("PASS") >= 2
