"""Frames with their checksums as opendbc makes them, for the tests of the map's protection.

``python -m tools.validation.car_checksums [--check]`` draws random frames, has opendbc's own
functions finish them, and writes (or compares) ``tests/support/car_frames.json``: of each frame the
message with the signals that matter, and the frames. It needs ``pip install opendbc==0.3.1``.
"""

import argparse
import ast
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

FILE = Path(__file__).parents[2] / "tests" / "support" / "car_frames.json"
VERSION = "0.3.1"
SOURCE = f"opendbc {VERSION}, Copyright (c) 2020, Comma.ai, Inc., MIT licence"
FRAMES = 64
STANDARD = 0x7FF
OF_A_DBC = {
    # maker: DBC, messages: their signal CHECKSUM has the function that its name stands for
    "toyota": ("toyota_nodsu_pt_generated", ("STEERING_LKA", "ACC_CONTROL")),
    "honda": ("honda_civic_touring_2016_can_generated", ("KINEMATICS", "STEER_MOTOR_TORQUE")),
    "honda, 29 bits": ("honda_insight_ex_2019_can_generated", ("LKAS_HUD_A",)),
    "subaru": ("subaru_global_2017_generated", ("ES_LKAS",)),
    "tesla": ("tesla_model3_party", ("DAS_steeringControl",)),
    "chrysler": ("chrysler_pacifica_2017_hybrid_generated", ("LKAS_COMMAND",)),
    "giorgio": ("fca_giorgio", ("EPS_1", "EPS_2", "ABS_1")),
    "vw_mqb": ("vw_mqb", ("Airbag_01", "ESP_21", "HCA_01")),
    "vw_mqbevo": ("vw_mqbevo", ("TSK_06",)),
    "vw_meb": ("vw_meb", ("ESC_50", "EML_06")),
    "vw_pq": ("vw_pq", ("HCA_1",)),
    "vw_mlb": ("vw_mlb", ("LS_01", "LH_EPS_03")),
    "hyundai_canfd": (
        "hyundai_canfd_generated",
        ("CAM_0x185", "LKAS", "WHEEL_SPEEDS", "ADRV_0x51"),
    ),
    "psa": ("psa_aee2010_r3", ("LANE_KEEP_ASSIST", "HS2_DAT_MDD_CMD_452")),
    "body": ("comma_body", ("TORQUE_CMD",)),
}
Frames = Iterator[tuple[str, str, bytes]]
"""DBC, message, and a frame with its checksum."""


@cache
def _packer(dbc: str) -> Any:  # noqa: ANN401
    return importlib.import_module("opendbc.can.packer").CANPacker(dbc)


def _message(dbc: str, name: str) -> Any:  # noqa: ANN401
    return _packer(dbc).dbc.name_to_msg[name]


def _set(frame: bytearray, dbc: str, message: str, signal: str, value: int) -> None:
    packer = importlib.import_module("opendbc.can.packer")
    packer.set_value(frame, _message(dbc, message).sigs[signal], value)


def _by_signal(rng: Random, dbc: str, message: str) -> bytes:
    """A random frame with the checksum that opendbc calculates for its signal."""
    found = _message(dbc, message)
    signal = next(s for s in found.sigs.values() if s.calc_checksum is not None)
    frame = bytearray(rng.randbytes(found.size))
    value = signal.calc_checksum(found.address, signal, bytearray(frame))
    _set(frame, dbc, message, signal.name, value)
    return bytes(frame)


def _by_function(
    rng: Random, dbc: str, message: str, signal: str, function: Callable[[bytes], int]
) -> bytes:
    """A random frame with the checksum that a function gives for it."""
    frame = bytearray(rng.randbytes(_message(dbc, message).size))
    _set(frame, dbc, message, signal, function(bytes(frame)))
    return bytes(frame)


def _of_a_test(name: str) -> Callable[[Any], Any]:
    """The function ``checksum`` of a test of opendbc, which as a whole needs a compiled library."""
    path = Path(importlib.import_module("opendbc").__file__ or "").parent / "safety" / "tests"
    tree = ast.parse((path / f"test_{name}.py").read_text(encoding="utf-8"))
    kept = [
        node
        for node in tree.body
        if (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).startswith("MSG_"))
        or (isinstance(node, ast.FunctionDef) and node.name == "checksum")
    ]
    names: dict[str, Any] = {}
    exec(compile(ast.Module(kept, []), str(path), "exec"), names)
    function: Callable[[Any], Any] = names["checksum"]
    return function


def _tested(rng: Random, maker: str, dbc: str, message: str, signals: tuple[str, ...]) -> bytes:
    """A random frame finished by a test's function, which wants the checksum's bits zero."""
    found = _message(dbc, message)
    frame = bytearray(rng.randbytes(found.size))
    for signal in signals:
        _set(frame, dbc, message, signal, 0)
    return bytes(_of_a_test(maker)((found.address, bytes(frame), 0))[1])


FORD = "ford_lincoln_base_pt"
HYUNDAI = "hyundai_kia_generic"
GM = "gm_global_a_powertrain_generated"


def _ford_lateral(rng: Random) -> bytes:
    message = "LateralMotionControl2"
    fordcan = importlib.import_module("opendbc.car.ford.fordcan")
    mode, counter = rng.randrange(8), rng.randrange(16)
    frame = bytearray(rng.randbytes(8))
    _set(frame, FORD, message, "LatCtl_D2_Rq", mode)
    _set(frame, FORD, message, "LatCtlPath_No_Cnt", counter)
    value = fordcan.calculate_lat_ctl2_checksum(mode, counter, frame)
    _set(frame, FORD, message, "LatCtlPath_No_Cs", value)
    return bytes(frame)


def _gm(rng: Random, which: str) -> bytes:
    gmcan = importlib.import_module("opendbc.car.gm.gmcan")
    packer, idx = _packer(GM), rng.randrange(4)
    if which == "ASCMLKASteeringCmd":
        torque = rng.randrange(-1024, 1024)
        sent = gmcan.create_steering_control(packer, 0, torque, idx, bool(rng.randrange(2)))
    elif which == "ASCMGasRegenCmd":
        full = bool(rng.randrange(2))
        throttle = rng.randrange(-22534, 43000)
        sent = gmcan.create_gas_regen_command(
            packer, 0, throttle, idx, bool(rng.randrange(2)), full
        )
    elif which == "ASCMSteeringButton":
        sent = gmcan.create_buttons(packer, 0, idx, rng.randrange(1, 7))
    else:
        car = type("Car", (), {"carFingerprint": ""})
        flags = [bool(rng.randrange(2)) for _ in range(3)]
        sent = gmcan.create_friction_brake_command(packer, 0, rng.randrange(400), idx, *flags, car)
    return bytes(sent[1])


def cases() -> Iterator[tuple[str, str, str, tuple[str, ...], Callable[[Random], bytes]]]:
    """Maker, DBC, message, the signals that matter, and what makes a frame."""
    for maker, (dbc, messages) in OF_A_DBC.items():
        for message in messages:
            found = _message(dbc, message)
            sums = tuple(s.name for s in found.sigs.values() if s.calc_checksum is not None)
            counters = tuple(s for s in found.sigs if s.casefold().endswith("counter"))
            yield (
                *(maker, dbc, message, (*sums, *counters)),
                lambda rng, dbc=dbc, message=message: _by_signal(rng, dbc, message),
            )
    nissan = importlib.import_module("opendbc.car.nissan.nissancan").nissan_checksum
    yield _made(
        "nissan", "nissan_x_trail_2017_generated", "LKAS", "CHECKSUM", lambda f: nissan(f[:7])
    )
    rivian = importlib.import_module("opendbc.car.rivian.riviancan").checksum
    for message, end in (("ACM_lkaHbaCmd", 0x63), ("ACM_longitudinalRequest", 0x12)):
        yield _made(
            "rivian", "rivian_primary_actuator", message, f"{message}_Checksum",
            lambda f, end=end: rivian(f[1:], 0x1D, end),
        )  # fmt: skip
    hyundai = importlib.import_module("opendbc.car.hyundai.hyundaican").hyundai_checksum
    for maker, function in (
        ("hyundai, CRC", lambda f: hyundai(f[:6] + f[7:8])),
        ("hyundai, 6 bytes", lambda f: sum(f[:6]) % 256),
        ("hyundai, 7 bytes", lambda f: (sum(f[:6]) + f[7]) % 256),
    ):
        yield _made(maker, HYUNDAI, "LKAS11", "CF_Lkas_Chksum", function)
    yield _made("hyundai, CRC", HYUNDAI, "FCA11", "CR_FCA_ChkSum", lambda f: hyundai(f[:7]))
    subaru = importlib.import_module("opendbc.car.subaru.subarucan").subaru_preglobal_checksum
    yield _made(
        "subaru, before global", "subaru_forester_2017_generated", "ES_LKAS", "Checksum",
        lambda f: subaru(_Fixed(f), {}, "ES_LKAS"),
    )  # fmt: skip
    speeds = tuple(f"WHL_SPD_{wheel}" for wheel in ("FL", "FR", "RL", "RR"))
    halves = ("WHL_SPD_Checksum_LSB", "WHL_SPD_Checksum_MSB")
    counter = ("WHL_SPD_AliveCounter_LSB", "WHL_SPD_AliveCounter_MSB")
    for maker, dbc, message, sums, others in (
        ("hyundai", HYUNDAI, "WHL_SPD11", halves, (*speeds, *counter)),
        ("hyundai", HYUNDAI, "EMS16", ("Checksum",), ()),
        ("hyundai", HYUNDAI, "SCC12", ("CR_VSM_ChkSum",), ()),
        ("hyundai", HYUNDAI, "TCS13", ("CheckSum_TCS3",), ()),
        ("ford", FORD, "Yaw_Data_FD1", ("VehRollYawW_No_Cs",),
         ("VehRolWActl_D_Qf", "VehYawWActl_D_Qf")),
        ("ford", FORD, "BrakeSysFeatures", ("VehVActlBrk_No_Cs",),
         ("VehVActlBrk_No_Cnt", "VehVActlBrk_D_Qf")),
        ("ford", FORD, "EngVehicleSpThrottle2", ("VehVActlEng_No_Cs",),
         ("VehVActlEng_No_Cnt", "VehVActlEng_D_Qf", "Veh_V_ActlEng")),
    ):  # fmt: skip
        yield (
            *(maker, dbc, message, (*sums, *others)),
            lambda rng, maker=maker, dbc=dbc, message=message, sums=sums: _tested(
                rng, maker, dbc, message, sums
            ),
        )
    signals = _message(FORD, "LateralMotionControl2").sigs
    lateral = tuple(name for name in signals if name.startswith("LatCtl"))
    yield "ford", FORD, "LateralMotionControl2", lateral, _ford_lateral
    for message, end in (
        ("ASCMLKASteeringCmd", "LKASteeringCmdChecksum"),
        ("EBCMFrictionBrakeCmd", "FrictionBrakeChecksum"),
        ("ASCMGasRegenCmd", "GasRegenChecksum"),
        ("ASCMSteeringButton", "SteeringButtonChecksum"),
    ):
        yield (
            *("gm", GM, message, (end, "RollingCounter")),
            lambda rng, message=message: _gm(rng, message),
        )


class _Fixed:
    """A packer that gives one frame, for a function that asks it for the frame."""

    def __init__(self, frame: bytes) -> None:
        self.frame = frame

    def make_can_msg(self, *_: object) -> tuple[int, bytes, int]:
        return 0, self.frame, 0


def _made(
    maker: str, dbc: str, message: str, signal: str, function: Callable[[bytes], int]
) -> tuple[str, str, str, tuple[str, ...], Callable[[Random], bytes]]:
    return (
        *(maker, dbc, message, (signal,)),
        lambda rng: _by_function(rng, dbc, message, signal, function),
    )


def _described(dbc: str, name: str, signals: tuple[str, ...]) -> str:
    """The lines of a DBC for a message and some of its signals."""
    found = _message(dbc, name)
    ident = found.address | (found.address > STANDARD) << 31
    lines = [f"BO_ {ident} {name}: {found.size} Car"]
    for signal in signals:
        its = found.sigs[signal]
        order = 1 if its.is_little_endian else 0
        lines.append(f' SG_ {signal} : {its.start_bit}|{its.size}@{order}+ (1,0) [0|0] "" Ecu')
    return "\n".join(lines)


def collected() -> dict[str, Any]:
    """What the file has."""
    found = {}
    vw = importlib.import_module("opendbc.car.volkswagen.mqbcan")
    constants: dict[int, list[int]] = vw.VOLKSWAGEN_MQB_MEB_CONSTANTS
    for maker, dbc, message, signals, make in cases():
        rng = Random(f"{maker} {message}")
        frames = " ".join(make(rng).hex() for _ in range(FRAMES))
        case: dict[str, Any] = {"file": dbc, "dbc": _described(dbc, message, signals)}
        if maker.startswith("vw") and _message(dbc, message).address in constants:
            case["constants"] = bytes(constants[_message(dbc, message).address]).hex()
        found[f"{maker}: {message}"] = {**case, "frames": frames}
    return {"source": SOURCE, "made by": "tools.validation.car_checksums", "cases": found}


def main() -> int:
    """Write or compare the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    args = parser.parse_args()
    text = json.dumps(collected(), indent=1) + "\n"
    if args.check:
        return int(FILE.read_text(encoding="utf-8") != text)
    FILE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
