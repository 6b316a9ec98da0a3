"""A bundle with the services: their own tests, the A2L, and what they cost if not chosen."""

import re

import pytest
from support.bundles import export, make

from canroll.cli import main
from canroll.codegen.export import bundle
from canroll.codegen.generated import signals
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import built_in
from canroll.codegen.subset.parse import load

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")


@pytest.mark.slow
def test_the_bundle_tests_its_own_services(tmp_path):
    bundle.write(tmp_path / "with", export(services=("xcp", "uds", "nvm", "nvm_uds")))
    done = make(tmp_path / "with", "test")
    assert done.returncode == 0, done.stderr
    assert re.search(r"PASS: XCP, 43 commands and \d+ answers", done.stdout)
    assert re.search(r"PASS: UDS, 32 frames and \d+ answers", done.stdout)
    assert "PASS: NVM, a record of 532 bytes" in done.stdout
    session = tmp_path / "with" / "test" / "session_xcp.c"
    text = session.read_text()
    session.write_text(text.replace(" 254, 38,", " 254, 39,", 1))
    assert session.read_text() != text
    assert make(tmp_path / "with", "test").returncode != 0
    a2l = (tmp_path / "with" / "canroll.a2l").read_text()
    assert "/begin DAQ" in a2l and "XCP_WRITE_ACCESS_WITHOUT_ECU_ONLY" in a2l
    assert "ADDR_EPK" not in a2l
    bundle.write(tmp_path / "without", export())
    names = {path.name for path in (tmp_path / "without").rglob("*")}
    assert not any("xcp" in name or "uds" in name or "nvm" in name for name in names)
    assert "/begin DAQ" not in (tmp_path / "without" / "canroll.a2l").read_text()


def test_the_loop_has_nothing_of_the_services():
    assert not {"xcp", "uds", "isotp", "nvm"} & set(load().modules)
    assert not any("xcp" in name or "uds" in name for name in built_in().files)


def test_options_that_exclude_each_other_are_refused(capsys, tmp_path):
    assert main.main(["export-c", str(tmp_path / "a"), "--xcp", "--specialise"]) == 2
    assert "--xcp: --specialise has the calibration compiled in" in capsys.readouterr().err
    assert main.main(["ecu", "--xcp", "--pace", "lockstep"]) == 2
    assert "--xcp: a tool does not wait for grants" in capsys.readouterr().err
    path = tmp_path / "map.toml"
    text = signals.MAP.read_text(encoding="utf-8")
    path.write_text(text[: text.index("# XCP:")])
    asked = ["export-c", str(tmp_path / "b"), "--xcp", "--dbc", str(signals.DBC)]
    assert main.main([*asked, "--map", str(path)]) == 2
    assert "no table [xcp]" in capsys.readouterr().err
