"""The A2L as two parsers of others read it: every address, type, limit and conversion."""

import re
from fractions import Fraction

import pytest

from canroll.codegen.export import a2l
from canroll.codegen.generated import bus_map, signals
from canroll.codegen.generated.bus_map import XcpFrames
from canroll.codegen.run import ecu_traffic, memory_image
from canroll.errors import CanrollError
from canroll.firmware.limits import LAST_BYTE
from canroll.firmware.subset import fields

pytest.importorskip("grpc", reason="needs pya2l")
pytest.importorskip("sqlalchemy", reason="needs pya2ldb")
# both install themselves as pya2l: only modules that one of them has alone are imported
parser = pytest.importorskip("pya2l.parser", reason="needs pya2l")
a2lparser = pytest.importorskip("pya2l.a2lparser", reason="needs pya2ldb")

BASE = {"calibration": 0x0800_4000, "ecu": 0x2000_0010, "canroll_epk": 0x0800_7F00}
SOFTWARE = a2l.Software(
    "canroll 1.2.3 0badcafe", ecu_traffic.random_calibration(2), XcpFrames(0x6F0, 0x6F1, 500_000)
)
TEXT = a2l.a2l(SOFTWARE, BASE)
TYPES = {"SLONG": ("i32", -(2**31), 2**31 - 1), "UBYTE": ("u8", 0, 255)}


def expected():
    """Of every field: address, stored type, shape, limits and the value of the integer 1."""
    for name, record in a2l.RECORDS.items():
        for field in fields(record):
            offset = memory_image.dtype(record).fields[field.name][1]
            yield f"{name}.{field.name}", field, BASE[name] + offset


@pytest.fixture(scope="module")
def tree():
    with parser.A2lParser() as reader:
        yield reader.tree_from_a2l(TEXT.encode()).PROJECT.MODULE[0]


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    path = tmp_path_factory.mktemp("a2l") / "canroll.a2l"
    path.write_text(TEXT, encoding="ascii")
    reader = a2lparser.A2LParser()
    from pya2l import model

    opened = reader.parse(str(path), in_memory=True, progress_bar=False, loglevel="ERROR")
    yield opened.session.query(model.Module).one()
    opened.close()


def one_stands_for(kind, coefficients):
    """The physical value of the integer 1 by a conversion."""
    if kind in ("IDENTICAL", "TAB_VERB"):
        return Fraction(1)
    a, b, c, d, e, f = (Fraction(value) for value in coefficients)
    assert (a, c, d, e) == (0, 0, 0, 0)
    return f / b


def check(field, kind, limits, unit, one):
    stored, lowest, highest = TYPES[kind]
    assert stored == field.kind
    assert one == Fraction(1, 2**field.f.q)
    assert [Fraction(limit) / one for limit in limits] == [field.f.lo, field.f.hi]
    assert lowest <= Fraction(limits[0]) / one <= Fraction(limits[1]) / one <= highest
    assert unit == field.f.unit.replace("·", ".")


def test_pya2l_reads_back_every_field(tree):
    methods = {method.Name.Value: method for method in tree.COMPU_METHOD}
    layouts = {layout.Name.Value: layout for layout in tree.RECORD_LAYOUT}
    found = {each.Name.Value: each for each in (*tree.CHARACTERISTIC, *tree.MEASUREMENT)}
    found |= {each.Name.Value: each for each in tree.AXIS_PTS}
    assert len(found) == sum(1 for _ in expected())
    for name, field, address in expected():
        its = found[name]
        method = methods[its.Conversion.Value]
        coeffs = method.COEFFS
        one = one_stands_for(
            method.ConversionType,
            [getattr(coeffs, k).Value for k in "ABCDEF"] if coeffs else [],
        )
        if name.startswith("ecu."):
            kind, at = its.DataType.Value, its.ECU_ADDRESS.Address.Value
        elif name.endswith(a2l.AXIS):
            kind = layouts[its.DepositR.Value].AXIS_PTS_X.DataType.Value
            at = its.Address.Value
        else:
            kind, at = layouts[its.Deposit.Value].FNC_VALUES.DataType.Value, its.Address.Value
        limits = (its.LowerLimit.Value, its.UpperLimit.Value)
        assert at == address, name
        check(field, kind, limits, method.Unit.Value, one)


def test_pya2ldb_reads_back_every_field(database):
    methods = {method.name: method for method in database.compu_method}
    layouts = {layout.name: layout for layout in database.record_layout}
    found = {each.name: each for each in (*database.characteristic, *database.measurement)}
    found |= {each.name: each for each in database.axis_pts}
    assert len(found) == sum(1 for _ in expected())
    for name, field, address in expected():
        its = found[name]
        method = methods[its.conversion]
        coeffs = method.coeffs
        one = one_stands_for(
            method.conversionType, [getattr(coeffs, k) for k in "abcdef"] if coeffs else []
        )
        if name.startswith("ecu."):
            kind, at = its.datatype, its.ecu_address.address
        elif name.endswith(a2l.AXIS):
            kind, at = layouts[its.depositAttr].axis_pts_x.datatype, its.address
        else:
            kind, at = layouts[its.deposit].fnc_values.datatype, its.address
        assert at == address, name
        check(field, kind, (its.lowerLimit, its.upperLimit), method.unit, one)
        if field.shape and field.name not in (*a2l.CURVES, a2l.AXIS):
            assert [n for n in its.matrix_dim.numbers if n > 1] == list(reversed(field.shape))


def test_values_with_names_have_a_table(database):
    tables = {
        table.name: {int(pair.inVal): pair.outVal for pair in table.pairs}
        for table in database.compu_vtab
    }
    assert tables["ecu_mode_values_table"] == {0: "INIT", 1: "ACTIVE", 2: "DEGRADED", 3: "SAFE"}
    assert tables["calibration_law_values_table"][2] == "compensator"
    assert tables["calibration_actuator_values_table"][1] == "bars"
    assert tables["ecu_status_values_table"][3] == "floating"
    assert tables["yes_no_table"] == {0: "no", 1: "yes"}
    for name, field, _ in expected():
        codes = a2l.enumeration(field)
        assert not codes or list(codes) == list(range(field.f.hi + 1)), name


def test_the_schedule_is_curves_over_speed(database):
    curves = {each.name: each for each in database.characteristic if each.type == "CURVE"}
    assert set(curves) == {f"calibration.{name}" for name in a2l.CURVES}
    for curve in curves.values():
        (axis,) = curve.axis_descr
        assert (axis.attribute, axis.inputQuantity) == ("COM_AXIS", "ecu.speed")
        assert axis.axis_pts_ref.axisPoints == "calibration.schedule_speed"
        assert axis.maxAxisPoints == 8


def test_groups_hold_every_field_once(tree):
    members = []
    for group in tree.GROUP:
        for reference in (group.REF_CHARACTERISTIC, group.REF_MEASUREMENT):
            members += [each.Value for each in reference.Identifier] if reference else []
    names = [name for name, field, _ in expected() if field.name != a2l.AXIS]
    assert sorted(members) == sorted(names)


def test_the_software_is_named_and_xcp_is_there(tree, database):
    parameters = database.mod_par
    assert parameters.epk.identifier == SOFTWARE.epk
    assert parameters.addr_epk[0].address == BASE["canroll_epk"]
    (segment,) = parameters.memory_segment
    assert (segment.address, segment.size) == (BASE["calibration"], LAST_BYTE + 1)
    constants = {each.name: each.value for each in parameters.system_constant}
    record = SOFTWARE.record
    assert constants["CALIBRATION_ID"] == f"0x{record.id:08X}"
    assert constants["CALIBRATION_CRC"] == f"0x{record.crc & 0xFFFFFFFF:08X}"
    raw = database.if_data[0].raw
    assert re.search(r"CAN_ID_MASTER 0x6F0\s+CAN_ID_SLAVE 0x6F1\s+BAUDRATE 500000", raw)
    assert tree.IF_DATA[0].Name.Value == "XCP"
    assert "IF_DATA" not in a2l.a2l(a2l.Software("x", record))


def test_addresses_of_an_image_may_change_again():
    moved = {"calibration": 0x1000, "ecu": 0x2000, "canroll_epk": 0x3000}
    assert a2l.located(TEXT, moved) == a2l.a2l(SOFTWARE, moved)
    assert a2l.located(a2l.located(TEXT, moved), BASE) == TEXT


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ("master = 128\nslave = 2\nbitrate = 3", "0x80 is the identifier of SuspensionForceComm"),
        ("master = 1\nslave = 2", "bitrate must be a whole number"),
        ("master = 1\nslave = 2\nbitrat = 3", "did you mean 'bitrate'"),
    ],
)
def test_wrong_identifiers_of_xcp_are_named(tmp_path, table, word):
    text = signals.MAP.read_text(encoding="utf-8")
    path = tmp_path / "map.toml"
    path.write_text(text[: text.index("[xcp]")] + f"[xcp]\n{table}\n")
    with pytest.raises(CanrollError, match=re.escape(word)):
        bus_map.load(signals.DBC, path)


@pytest.mark.parametrize("content", [b"", b"\x7fELF", b"ELF" * 99])
def test_an_image_that_is_no_elf_file_is_refused(tmp_path, content):
    path = tmp_path / "firmware.elf"
    path.write_bytes(content)
    with pytest.raises(CanrollError, match="not a readable ELF file") as refusal:
        a2l.addresses(path)
    assert "\n" not in str(refusal.value)
