"""canroll export-fmu refuses in one line what does not apply."""

import zipfile

import pytest

from canroll.cli.main import parse
from canroll.errors import CanrollError
from canroll.extensions.exchange.cli import export_fmu


@pytest.mark.slow
def test_an_ecu_has_sources_and_a_library(tmp_path, capsys):
    out = tmp_path / "ecu.fmu"
    assert export_fmu.run(parse(["export-fmu", "ecu", str(out), "--law", "lqr"])) == 0
    assert "lqr for van_real" in capsys.readouterr().out
    names = zipfile.ZipFile(out).namelist()
    assert "modelDescription.xml" in names
    assert "sources/canroll_ecu.c" in names
    assert any(name.startswith("binaries/") for name in names)


@pytest.mark.slow
def test_a_bus_carries_authenticated_frames_as_any_other(tmp_path, capsys):
    out = tmp_path / "bus.fmu"
    assert export_fmu.run(parse(["export-fmu", "bus", str(out), "--bus", "secured_fd"])) == 0
    assert "CAN bus secured_fd with 6 nodes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["bus", "x.fmu", "--law", "lqr"], "--law: it does not apply to the bus"),
        (["bus", "x.fmu", "--ports", "signals"], "--ports: it does not apply to the bus"),
        (["bus", "x.fmu", "--nodes", "-1"], "--nodes must be 0 to"),
        (["plant", "x.fmu", "--fault", "Imu=loss:0.5"], "not part of the plant"),
        (["plant", "x.fmu", "--bus", "secured_fd"], "export-fmu plant cannot authenticate"),
        (["ecu", "x.fmu", "--bus", "secured_fd"], "export-fmu ecu cannot authenticate"),
        (["ecu", "out.zip"], "ends in .fmu"),
        (["ecu", "no/such/folder/x.fmu"], "cannot write no/such/folder/x.fmu"),
    ],
)
def test_what_does_not_apply_or_cannot_be_is_refused(words, message):
    with pytest.raises(CanrollError, match=message):
        export_fmu.run(parse(["export-fmu", *words]))
