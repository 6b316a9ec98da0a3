"""A bundle with authenticated frames: it compiles, tests itself, and has its key in one file."""

import shutil
import subprocess

import pytest
from cryptography.hazmat.primitives.ciphers import algorithms
from cryptography.hazmat.primitives.cmac import CMAC
from support.bundles import export, make

from canroll import dbc
from canroll.codegen.export import bundle
from canroll.codegen.export.sessions import secoc_session
from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import built_in, of_bus
from canroll.dbc.keys import DEVELOPMENT_KEY

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="needs cc")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    its = tmp_path_factory.mktemp("bundle")
    paths = {"dbc": dbc.SECURED_PATH, "map_file": dbc.SECURED_MAP}
    bundle.write(its, export(ecu_traffic.random_calibration(1), **paths))
    return its


@pytest.mark.slow
@needs_cc
def test_it_tests_itself_and_a_wrong_table_fails(folder):
    ran = make(folder, "build/secoc")
    assert ran.returncode == 0, ran.stderr
    assert "warning" not in ran.stderr
    said = subprocess.run([folder / "build" / "secoc"], capture_output=True, text=True, check=True)
    assert said.stdout == "PASS: SecOC, 24 frames sent and 18 judged, byte for byte\n"
    tables = folder / "src" / "canroll_aes_tables.c"
    text = tables.read_text(encoding="utf-8")
    wrong = text.replace("    99, 124, 119", "    98, 124, 119", 1)
    assert wrong != text
    tables.write_text(wrong, encoding="utf-8")
    assert make(folder, "build/secoc").returncode == 0
    failed = subprocess.run([folder / "build" / "secoc"], capture_output=True, check=False)
    tables.write_text(text, encoding="utf-8")
    assert failed.returncode == 1
    assert failed.stdout.startswith(b"FAIL: SecOC, ")


@pytest.mark.slow
@needs_cc
def test_the_example_compiles_with_authentication(folder, tmp_path):
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-int-to-pointer-cast", "-c"]
    command += [f"-I{folder / 'include'}", "-o", str(tmp_path / "node.o")]
    made = subprocess.run(
        [*command, str(folder / "board" / "node.c")], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    text = (folder / "board" / "node.c").read_text(encoding="utf-8")
    for call in ("start", "elapse", "verify", "protect"):
        assert f"canroll_secoc_{call}(&secoc" in text
    assert "{secoc" not in text


def test_the_key_is_in_one_file_that_says_what_it_is(folder):
    digits = ", ".join(f"0x{byte:02X}" for byte in DEVELOPMENT_KEY)
    holding = []
    for path in folder.rglob("*"):
        if path.is_file() and "build" not in path.parts:
            data = path.read_bytes()
            assert DEVELOPMENT_KEY not in data
            assert DEVELOPMENT_KEY.hex().encode() not in data.lower()
            if digits.encode() in data:
                holding.append(path.name)
    assert holding == ["canroll_key.c"]
    assert "REPLACE THIS FILE" in (folder / "src" / "canroll_key.c").read_text(encoding="utf-8")
    assert "replace the file" in (folder / "README.md").read_text(encoding="utf-8")


@needs_cc
def test_the_public_key_compiles_where_it_is_asked_for_alone(folder, tmp_path):
    command = ["cc", "-std=c99", "-c", f"-I{folder / 'include'}", "-o", str(tmp_path / "key.o")]
    command += [str(folder / "src" / "canroll_key.c")]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode != 0
    assert "has the public development key: replace it" in refused.stderr
    subprocess.run([*command, "-DCANROLL_PUBLIC_KEY"], check=True)


def test_the_session_is_that_of_another_implementation():
    session = secoc_session.session(of_bus(dbc.SECURED_PATH, dbc.SECURED_MAP))
    sent = [step.expected for step in session.parts[0].steps if step.operation.array == 20]
    data_id = dbc.data_id(dbc.message("SuspensionForceCommand"))
    judge = CMAC(algorithms.AES(secoc_session.TEST_KEY))
    payload = bytes(range(8))
    frame = payload + bytes([0, 0, 7, 0, 0, 0])
    judge.update(data_id.to_bytes(2, "big") + frame)
    assert frame + judge.finalize()[:6] in sent


def test_a_plain_bundle_has_nothing_of_it():
    template = (bundle.TEMPLATES / "node.c").read_text(encoding="utf-8")
    plain = secoc_session.example(template, built_in(), ecu_traffic.random_calibration(1))
    assert "secoc" not in plain
    assert "static canroll_ecu ecu;\n\n__attribute__((weak)) int node_next" in plain
