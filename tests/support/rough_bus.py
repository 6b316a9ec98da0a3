"""The example of a user's bus as real cars' files describe one: with all their defects."""

from pathlib import Path

OWN = Path(__file__).parents[2] / "examples" / "own_bus"
MORE = """
BO_ 402 SUSP_OLD: 8 Suspension
 SG_ SU_Old : 0|16@1- (1,0) [0|0] "" RollController

BO_ 600 NM_Alive: 0 Brakes

BO_ 601 DIAG_01: 8 Brakes
 SG_ DI_Service M : 0|8@1+ (1,0) [0|0] "" RollController
 SG_ DI_Group m1M : 8|8@1+ (1,0) [0|0] "" RollController
 SG_ DI_Value m2 : 16|16@1+ (1,0) [0|0] "" RollController

BO_ 1073741900 TP_01: 8 Brakes
 SG_ TP_Data : 0|8@1+ (1,0) [0|0] "" RollController

BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX
 SG_ Lonely : 0|8@1+ (1,0) [0|0] "" Vector__XXX

CM_ SG_ 257 "name missing";
CM_ BO_ 257 "Gierrate über Achse";
"""
END = """VAL_ 257 GY_Absent 0 "aus";
VAL_ 3221225472 Lonely 0 "aus";
SG_MUL_VAL_ 601 DI_Group DI_Service 1-1;
SG_MUL_VAL_ 601 DI_Value DI_Group 2-2, 4-6;
SIG_VALTYPE_ 257 GY_Temperature 1;
"""
DEFECTS = (
    ("BO_ 2566844417", "BO_ 419360769"),  # the bit of an extended frame is missing
    ("BO_ 2566844417", "BO_ 419360769"),  # in its attribute too
    ('(0.005,0) [0|163.83] "Unit_DegreOfArcPerSecon"', '(.005,0) [0|163.83] "°/s"'),
    ('"km/h"', '"Kph"'),
    # a status byte, overlaid by its bits
    (" SG_ AC_StatusFL", ' SG_ AC_Status : 32|8@1+ (1,0) [0|0] "" Any\n SG_ AC_StatusFL'),
    # a float beside what is used
    (" SG_ GY_YawRate", ' SG_ GY_Temperature : 32|32@1- (1,0) [0|0] "" Any\n SG_ GY_YawRate'),
    # a command that is longer than said, and overlaid as a whole
    ("ROLL_CMD: 8", "ROLL_CMD: 3"),
    (" SG_ RC_Mode", ' SG_ RC_All : 8|32@1+ (1,0) [0|0] "" Any\n SG_ RC_Mode'),
    ('BA_ "GenMsgCycleTime" BO_ 402 10;\n', ""),
    ("\nBA_DEF_", f"{MORE}\nBA_DEF_"),
)


def write(folder: Path) -> tuple[Path, Path]:
    """Write the defective network and its map; return their paths."""
    text = (OWN / "own.dbc").read_text(encoding="utf-8")
    for old, new in DEFECTS:
        assert old in text
        text = text.replace(old, new, 1)
    table = (OWN / "own.toml").read_text(encoding="utf-8")
    for name, keys in (("SUSP_02", "id = 402\nperiod_ms = 10"), ("ROLL_CMD", "bytes = 8")):
        there = f'message = "{name}"\n'
        assert there in table
        table = table.replace(there, f"{there}{keys}\n")
    (folder / "rough.dbc").write_bytes((text + END).encode("cp1252"))
    (folder / "rough.toml").write_text(table, encoding="utf-8")
    return folder / "rough.dbc", folder / "rough.toml"
