"""Checksums of real cars: frames that opendbc's own functions finished, and the map's entries.

``support/car_frames.json`` has random frames that opendbc 0.3.1 finished; most entries of the map
are those of examples/cars/checksums.
"""

import json
import tomllib
from itertools import count
from pathlib import Path

import pytest
from cantools.database import load_string
from support.compiled_protection import CompiledProtection

from canroll.codegen.frame.frame_protection import protection
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import of_bus

SUPPORT = Path(__file__).parents[2] / "support"
CASES = json.loads((SUPPORT / "car_frames.json").read_text(encoding="utf-8"))["cases"]
CHECKSUMS = Path(__file__).parents[3] / "examples" / "cars" / "checksums"
CARS = tomllib.loads((CHECKSUMS / "checksums.toml").read_text(encoding="utf-8"))
GM = (
    (CHECKSUMS / "gm.py").read_text(encoding="utf-8")
    + '''

# four times the counter's factor, without and with ACCAlwaysOne
FACTORS: tuple[i32, ...] = (0x3F0, 0x4EF)


def buttons(payload: Annotated[list[u8], 7], identifier: i32) -> i32:
    """Return the checksum of ASCMSteeringButton."""
    one: i32 = payload[3] & 1
    counter: i32 = payload[4] & 3
    pressed: i32 = (payload[5] >> 4) & 7
    distance: i32 = (payload[2] >> 6) & 1
    value: i32 = 240 + one * 15 + counter * FACTORS[one]
    return value - ((pressed - 1) << 4) - 2 * distance
'''
)
TESLA = "DAS_steeringControlChecksum"
LATERAL = (
    "D2_Rq",
    "Path_No_Cnt",
    "Curv_No_Actl",
    "Crv_NoRate2_Actl",
    "Path_An_Actl",
    "PathOffst_L_Actl",
)
FORD = {"method": "sum", "end": 0xFF}
OF_MESSAGES = {
    # message: car of the page, and what is different with it
    "subaru, before global": ("subaru", {"signal": "Checksum", "over": ["frame"]}),
    "honda, 29 bits": ("honda", {"start": 11}),
    "tesla": ("subaru", {"signal": TESLA}),
    "giorgio: EPS_1": ("giorgio", {"end": 0x10}),
    "giorgio: EPS_2": ("giorgio", {"end": 0xF6}),
    "vw_mqbevo": ("vw_mqb", {}),
    "vw_meb": ("vw_mqb", {}),
    "vw_mlb: LS_01": ("vw_pq", {"start": 0x0A}),
    "vw_mlb: LH_EPS_03": ("vw_mqb", {}),
    "nissan": ("chrysler", {}),
    "rivian: ACM_longitudinalRequest": (
        "rivian",
        {"signal": "ACM_longitudinalRequest_Checksum", "end": 0x12},
    ),
    "hyundai, CRC: LKAS11": ("hyundai_crc", {}),
    "hyundai, CRC: FCA11": ("hyundai_crc", {"signal": "CR_FCA_ChkSum"}),
    "hyundai, 6 bytes": ("hyundai_bytes", {"over": ["bytes 0-5"]}),
    "hyundai, 7 bytes": ("hyundai_bytes", {}),
    "hyundai: WHL_SPD11": ("hyundai_bits", {}),
    "hyundai: EMS16": ("hyundai_nibbles", {}),
    "hyundai: SCC12": ("hyundai_nibbles", {"signal": "CR_VSM_ChkSum"}),
    "hyundai: TCS13": ("hyundai_nibbles", {"signal": "CheckSum_TCS3", "over": ["bytes 0-6"]}),
    "hyundai_canfd: LKAS": ("hyundai_canfd", {"end": 0x041D}),
    "hyundai_canfd: WHEEL_SPEEDS": ("hyundai_canfd", {"end": 0x819D}),
    "hyundai_canfd: ADRV_0x51": ("hyundai_canfd", {"end": 0x9F5B}),
    "psa: HS2_DAT_MDD_CMD_452": ("psa", {"start": 4}),
    "body": ("comma_body", {}),
    "ford: Yaw_Data_FD1": ("ford_yaw", {}),
    "ford: BrakeSysFeatures": (
        "",
        {**FORD, "signal": "VehVActlBrk_No_Cs"}
        | {"over": ["bytes 0-1", {"signal": "VehVActlBrk_No_Cnt"}, {"signal": "VehVActlBrk_D_Qf"}]},
    ),
    "ford: EngVehicleSpThrottle2": (
        "",
        {**FORD, "signal": "VehVActlEng_No_Cs"}
        | {
            "over": [{"signal": f"VehVActlEng_{name}"} for name in ("No_Cnt", "D_Qf")]
            + ["bytes 6-7"]
        },
    ),
    "ford: LateralMotionControl2": (
        "",
        {**FORD, "signal": "LatCtlPath_No_Cs"}
        | {"over": [{"signal": f"LatCtl{'_' if n == 'D2_Rq' else ''}{n}"} for n in LATERAL]},
    ),
    "gm: ASCMLKASteeringCmd": ("gm_steering", {}),
    "gm: EBCMFrictionBrakeCmd": ("gm_steering", {"signal": "FrictionBrakeChecksum"}),
    "gm: ASCMGasRegenCmd": ("", {"signal": "GasRegenChecksum", "function": "gm.py:gas_regen"}),
    "gm: ASCMSteeringButton": (
        "",
        {"signal": "SteeringButtonChecksum", "function": "gm.py:buttons"},
    ),
}


def entry(case):
    """The protection of a case in a map."""
    maker = case.partition(":")[0]
    car, other = OF_MESSAGES.get(case, OF_MESSAGES.get(maker, (maker, {})))
    table = {"profile": "own", **(CARS[car] if car else {})}
    table["checksum"] = {**table.get("checksum", {}), **other}
    if table["checksum"].get("method") == "crc8_h2f":
        table["checksum"]["constant"] = list(bytes.fromhex(CASES[case]["constants"]))
    return table


def dbc(*cases):
    lines = "\n".join(CASES[case]["dbc"] for case in cases)
    return f'VERSION ""\nBU_: Ecu Car\n{lines}\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of maps, with the functions of General Motors."""
    path = tmp_path_factory.mktemp("cars")
    (path / "gm.py").write_text(GM, encoding="utf-8")
    return path


@pytest.mark.parametrize("case", CASES)
def test_frames_of_a_car_have_the_checksum_that_the_map_describes(case, folder):
    message = load_string(dbc(case), "dbc").messages[0]
    its = protection(message, entry(case), (), "map.toml", folder)
    place = its.checksum.place
    for text in CASES[case]["frames"].split():
        frame = bytearray.fromhex(text)
        counter = its.counter.read(frame) if its.counter else 0
        ours = bytearray(frame)
        place.write(ours, ~place.read(frame))
        its.apply(ours, counter)
        assert ours == frame


def toml(value):
    """A value as TOML has it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(part)}" for key, part in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def buses():
    """Cases in groups whose frames have different identifiers, one for each mailbox that sends."""
    groups = []
    for case in CASES:
        ident = CASES[case]["dbc"].split()[1]
        fitting = (g for g in groups if len(g) < 6 and ident not in g)
        group = next(fitting, None)
        if group is None:
            group = {}
            groups.append(group)
        group[ident] = case
    return [list(group.values()) for group in groups]


MAILBOXES = ("suspension_force", "anti_roll_bar", "damper", "valve", "status", "diagnostics")


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize("cases", buses(), ids=lambda cases: cases[0])
def test_the_firmware_sends_frames_of_cars_byte_for_byte(cases, folder, tmp_path):
    """In CPython and in C, of a firmware that is proved."""
    dbc_file, map_file = folder / "cars.dbc", folder / "cars.toml"
    text = dbc(*cases)
    lines = ["schema = 1"]
    for mailbox, case in zip(MAILBOXES, cases, strict=False):
        name = CASES[case]["dbc"].split()[2].rstrip(":")
        lines += [f"[transmit.{mailbox}]", f'message = "{name}"', "fd = true"]
        lines += [f"protection = {toml(entry(case))}"]
    dbc_file.write_text(text, encoding="utf-8")
    map_file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    firmware = of_bus(dbc_file, map_file)
    assert not prove(firmware.program()).findings
    compiled = CompiledProtection(firmware, tmp_path)
    module = firmware.module("com.protection")
    ecu = firmware.record()
    room = len(ecu.tx_payload[0])
    for slot, case in zip(count(), cases):
        its = firmware.bus.transmitted[slot].protection
        for sent in CASES[case]["frames"].split():
            frame = bytearray.fromhex(sent)
            ecu.tx_counter[slot] = its.counter.read(frame) if its.counter else 0
            for protect in (module.protect, compiled.protect):
                ours = bytearray(frame)
                its.checksum.place.write(ours, ~its.checksum.place.read(frame))
                ecu.tx_payload[slot] = [*ours, *bytes(room - len(ours))]
                protect(ecu, slot)
                assert bytes(ecu.tx_payload[slot][: len(frame)]) == frame, case
