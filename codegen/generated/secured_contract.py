"""dbc/roll_control_secured.dbc and its map: the bus contract in authenticated CAN FD frames.

    python -m canroll.codegen.generated.secured_contract [--check]

writes (or compares) both files. A frame is that of ``roll_control.dbc`` with freshness value and
MAC behind it, as :mod:`canroll.firmware.security.secoc` has them; its E2E protection covers the
first eight bytes.
"""

import argparse
import re
import sys

from canroll import dbc
from canroll.codegen.generated.authenticated_frames import AUTHENTICATOR, FRESHNESS
from canroll.firmware.security.secoc_state import FRESHNESS_AT, MAC_AT, PAYLOAD, SECURED

FD_FORMAT = 14
"""Index of StandardCAN_FD among the values of VFrameFormat."""
DEFINITIONS = """\
BA_DEF_ "BusType" STRING;
BA_DEF_ "Baudrate" INT 0 1000000;
BA_DEF_ "BaudrateCANFD" INT 0 8000000;
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","reserved","reserved",\
"reserved","reserved","reserved","reserved","reserved","reserved","reserved","reserved","reserved",\
"StandardCAN_FD","ExtendedCAN_FD";
BA_DEF_ BO_ "CANFD_BRS" ENUM "0","1";
BA_DEF_ BO_ "E2EDataLength" INT 0 512;
"""
DEFAULTS = """\
BA_DEF_DEF_ "BusType" "CAN";
BA_DEF_DEF_ "Baudrate" 500000;
BA_DEF_DEF_ "BaudrateCANFD" 2000000;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "CANFD_BRS" "1";
BA_DEF_DEF_ "E2EDataLength" 0;
"""
VALUES = """\
BA_ "BusType" "CAN FD";
BA_ "Baudrate" 500000;
BA_ "BaudrateCANFD" 2000000;
"""
MAP_HEAD = """\
# Which signal of roll_control_secured.dbc is which field of the ECU's record, as roll_control.toml
# has it; made by canroll.codegen.generated.secured_contract, not to be edited.
"""
MAP_TAIL = f"""
# every frame is authenticated: signals of the freshness value and of the MAC
[secoc]
freshness = "{FRESHNESS}"
authenticator = "{AUTHENTICATOR}"
"""


def database() -> str:
    """Return the text of dbc/roll_control_secured.dbc."""
    plain = dbc.PATH.read_text(encoding="utf-8")
    secured = re.sub(
        r"(BO_ \d+ \w+: )8 (\w+\n(?: SG_ .*\n)*? SG_ .*\"\" (\S+)\n(?: SG_ .*\n)*)",
        lambda found: (
            f"{found[1]}{SECURED} {found[2]}"
            f' SG_ {FRESHNESS} : {8 * FRESHNESS_AT + 7}|48@0+ (1,0) [0|{2**48 - 1}] "" {found[3]}\n'
            f' SG_ {AUTHENTICATOR} : {8 * MAC_AT + 7}|48@0+ (1,0) [0|{2**48 - 1}] "" {found[3]}\n'
        ),
        plain,
    )
    secured = secured.replace(
        'counter 0 to 14.";',
        "counter 0 to 14; they cover the first 8 bytes. Bytes 8 to 19 are those of AUTOSAR "
        'SecOC.";',
        1,
    )
    idents = re.findall(r"^BO_ (\d+)", secured, flags=re.MULTILINE)
    comments = "".join(
        f'CM_ SG_ {ident} {FRESHNESS} "SecOC: number of starts of the sender (24 bits), '
        'number of the frame since.";\n'
        f'CM_ SG_ {ident} {AUTHENTICATOR} "SecOC: first 48 bits of the AES-128-CMAC.";\n'
        for ident in idents
    )
    formats = "".join(
        f'BA_ "VFrameFormat" BO_ {ident} {FD_FORMAT};\n'
        f'BA_ "E2EDataLength" BO_ {ident} {8 * PAYLOAD};\n'
        for ident in idents
    )
    head, _, rest = secured.partition("BA_DEF_ BO_")
    definitions, _, rest = rest.partition("BA_DEF_DEF_")
    defaults, _, values = rest.partition("BA_ ")
    return "".join(
        [
            *(head, comments, DEFINITIONS, "BA_DEF_ BO_", definitions),
            *(DEFAULTS, "BA_DEF_DEF_", defaults, VALUES, formats, "BA_ ", values),
        ]
    )


def map_text() -> str:
    """Return the text of dbc/roll_control_secured.toml."""
    plain = dbc.PATH.with_suffix(".toml").read_text(encoding="utf-8")
    tables = plain[plain.index("schema = 1") :]
    own = tables.partition("# XCP")[0].rstrip()
    return f"{MAP_HEAD}\n{own}\n{MAP_TAIL}"


def main() -> int:
    """Write both files, or with ``--check`` return 1 if one is out of date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args().check
    current = True
    for path, text in ((dbc.SECURED_PATH, database()), (dbc.SECURED_MAP, map_text())):
        if check:
            current &= path.read_text(encoding="utf-8") == text
        else:
            path.write_text(text, encoding="utf-8")
    return 0 if current else 1


if __name__ == "__main__":
    sys.exit(main())
