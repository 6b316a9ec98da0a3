"""Comments for a reviewer: complete, true, and without effect on the code."""

import re
import subprocess

import pytest

from canroll.codegen.export import annotate, traceability
from canroll.codegen.run import ecu_traffic, native
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.specialised import specialised
from canroll.codegen.subset.formats import Formats, Scope
from canroll.codegen.subset.program import FieldReference
from canroll.codegen.subset.walk import walk

SERVED = with_services(built_in(), ("xcp", "uds", "nvm", "nvm_uds"))


def special():
    return specialised(built_in(), ecu_traffic.random_calibration(7))


CODES = {"general": lambda: SERVED, "specialised": special}


@pytest.fixture(params=CODES, scope="module")
def code(request):
    firmware = CODES[request.param]()
    return firmware, annotate.files(firmware)


@pytest.mark.slow
def test_the_comments_are_all_that_differs(code):
    firmware, files = code
    comment = re.compile(r"^ */\* (\w+\.py:\d.*, requirement: .*|.* -> Q\d+) \*/\n", re.MULTILINE)
    assert files.keys() == firmware.files.keys()
    assert files != firmware.files
    assert {name: comment.sub("", text) for name, text in files.items()} == firmware.files
    assert all(line.isascii() for line in files.values())


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_the_object_code_is_the_same(code, tmp_path):
    firmware, files = code
    for folder, texts in (("plain", firmware.files), ("noted", files)):
        (tmp_path / folder).mkdir()
        for name, text in texts.items():
            (tmp_path / folder / name).write_text(text)
        for name in texts:
            if name.endswith(".c"):
                command = ["cc", "-O2", "-c", name]
                subprocess.run(command, cwd=tmp_path / folder, check=True, timeout=600)
    plain, noted = (sorted((tmp_path / folder).glob("*.o")) for folder in ("plain", "noted"))
    assert [path.name for path in plain] == [path.name for path in noted] != []
    for one, other in zip(plain, noted, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


@pytest.mark.slow
def test_above_every_function_are_its_source_and_requirement(code):
    firmware, files = code
    traced = traceability.rows(firmware.program(), files)
    seen = 0
    for requirement, rows in traced.items():
        for row in rows:
            if row.emitted == traceability.NO_CODE:
                continue
            file, _, line = row.emitted.removeprefix("src/").partition(":")
            above = files[file].splitlines()[int(line) - 2]
            source = row.source.replace("–", "-")
            assert above == f"/* {source}, requirement: {requirement} */"
            seen += 1
    assert seen > 100


def test_formats_are_those_of_the_fields():
    program = built_in().program()
    formats = Formats(program)
    notes = {
        ".".join(function.key): [formats.note(function, node) for node in walk(function.node)]
        for function in program.functions()
    }
    assert "Q14 x Q30 >> 30 -> Q14" in notes["allocation.front_moment"]
    assert "Q24 x Q24 -> Q48" in notes["covariance.update"]
    assert "Q12 x Q30 >> 30 -> Q12" in notes["samples.watch_signal"]
    # an eighth of a value, not another format; and raw values of a frame, which have no format
    assert not any(notes["envelope.outward"])
    assert not any(notes["signals.pack_suspension_force"])


def test_no_known_format_contradicts_the_field_it_is_stored_in():
    program = built_in().program()
    formats, stored = Formats(program), 0
    for function in program.functions():
        scope = Scope(function, formats.known)
        for node in walk(function.node):
            target = getattr(node, "targets", [None])[0]
            if isinstance(program.refs.get(target), FieldReference):
                into, value = formats._of(target, scope), formats._of(node.value, scope)
                if into is not None and value is not None and value.certain:
                    assert value.places == into.places, f"{function.key}, line {node.lineno}"
                    stored += 1
    assert stored > 20
