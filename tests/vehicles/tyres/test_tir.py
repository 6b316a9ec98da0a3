"""Tyre property files: what is read, and what is refused in one line with file and line."""

from pathlib import Path

import pytest

from canroll.errors import CanrollError
from canroll.vehicles.tyres import tir

FOLDER = Path(__file__).parent
TEXT = (FOLDER / "passenger_61.tir").read_text()


@pytest.fixture
def read(tmp_path):
    def of(text):
        path = tmp_path / "t.tir"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return tir.read(path)

    return of


def test_comments_line_ends_and_order_do_not_matter(read):
    plain = read(TEXT).values
    assert plain["PCX1"] == 1.62 and plain["TYRESIDE"] == 1.0 and plain["FITTYP"] == 61.0
    assert read(TEXT.replace("\n", "\r\n")).values == plain
    assert (
        read(TEXT.replace(" = ", "\t=\t").replace("= 4000", "= 4.0D3 $ N ! of load")).values
        == plain
    )
    assert read(TEXT.replace("PCX1 ", "pcx1 ") + "[OTHER]\nNEW_KEY = 'a = $ b'\n").values == plain


def test_missing_coefficients_are_those_of_the_version(read):
    lines = [line for line in TEXT.splitlines() if not line.startswith(("PKY4", "PEX2", "LKY "))]
    tyre = read("\n".join(lines) + "\nPEX3_OLD =\n")
    assert (tyre["PKY4"], tyre["PEX2"], tyre["LKY"]) == (2.0, 0.0, 1.0)
    assert "PKY4" not in tyre.values


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("'meter'", "'mm'", r"t.tir, line 12: LENGTH in mm: only SI units .* meter"),
        ("'radians'", "'degrees'", "ANGLE in degrees"),
        (
            "= 61 ",
            "= 70 ",
            r"line 18: FITTYP = 70: only the Magic Formula 5.2 \(6, 21 or 52\), 6.1",
        ),
        ("FITTYP ", "FITTYPE ", "t.tir: FITTYP is missing"),
        ("'LEFT'", "'BOTH'", "TYRESIDE is 'BOTH': must be LEFT or RIGHT"),
        ("= 1.62", "= one", "PCX1 = 'one' is not a number"),
        ("= 1.62", "= nan", "PCX1 = 'nan' is not a number"),
        ("= -22.4", "= 22.4", "PKY1 = 22.4: must be negative .* SAE"),
        ("= 4000", "= 0", "FNOMIN = 0: must be positive"),
        ("PCX1 ", "PCX1 = 1.5\nPCX1 ", r"PCX1 again, it stands in line \d+ already"),
        ("LKYC  ", "LGAY  ", "LGAY"),
        ("[MODEL]", "[MODEL]\nnothing here", "'nothing here' is neither"),
    ],
)
def test_what_is_no_such_tyre_is_refused_in_one_line(read, old, new, message):
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    if "LGAY" in message:
        text = text.replace("LGAY                     = 1.0", "LGAY                     = 0.9")
    with pytest.raises(CanrollError, match=message) as caught:
        read(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", b"", b"[MODEL]\n\x00"])
def test_what_is_no_text_is_refused(read, data):
    with pytest.raises(CanrollError, match=r"t\.tir"):
        read(data)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CanrollError, match=r"cannot read tyre file .*no.tir"):
        tir.read(tmp_path / "no.tir")
