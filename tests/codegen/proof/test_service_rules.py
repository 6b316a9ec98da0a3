"""A service that stores where it may not is refused with its line."""

from dataclasses import replace

import pytest

from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.service import SERVICES, Service
from canroll.codegen.subset.program import SubsetError
from canroll.errors import CanrollError

STATE = '''"""State."""

from typing import Annotated

from canroll.firmware.subset import F, i32, record


@record
class Sneaky:
    """A record."""

    n: Annotated[i32, F(0, 9, 0, "", "a number")]
'''
MODULE = '''"""A service."""

from canroll.firmware.calibration import Calibration
from canroll.firmware.plausibility import latch_faults
from canroll.firmware.state import Ecu
from canroll.firmware.subset import i32, set_octet
from {package}.sneaky_state import Sneaky


def tick(sneaky: Sneaky, ecu: Ecu, cal: Calibration, working: Calibration, elapsed: i32) -> None:
    """Do its work."""
    sneaky.n = 1
    {line}
'''
ALLOWED = ("sneaky.n = 2", "ecu.law = cal.law", "set_octet(working, 0, 1)")
REFUSED = {
    "ecu.moment = 0": "stores in the loop's law only",
    "ecu.x[0] = 1": "stores in the loop's law only",
    "latch_faults(ecu)": "stores in the loop's law only",
    "set_octet(cal, 0, 1)": "stores in cal",
}


@pytest.fixture
def served(tmp_path, monkeypatch):
    """Return the firmware with a service of one line."""

    def make(line):
        # what a service has is kept by its name
        name = f"sneaky{[*ALLOWED, *REFUSED].index(line)}"
        folder = tmp_path / f"of_{name}"
        folder.mkdir()
        (folder / "__init__.py").write_text("")
        (folder / "sneaky_state.py").write_text(STATE)
        (folder / f"{name}.py").write_text(MODULE.format(package=folder.name, line=line))
        monkeypatch.syspath_prepend(tmp_path)
        records = {"sneaky": "sneaky_state.Sneaky", "working": "calibration.Calibration"}
        kind = Service(modules=folder.name, records=records, stores=("law",))
        monkeypatch.setitem(SERVICES, name, kind)
        return with_services(built_in(), (name,))

    return make


@pytest.mark.parametrize("line", ALLOWED)
def test_what_a_service_may_do_is_translated(served, line):
    assert any(name.startswith("canroll_sneaky") for name in served(line).files)


@pytest.mark.parametrize(("line", "says"), REFUSED.items())
def test_a_store_outside_of_it_is_refused_with_its_line(served, line, says):
    with pytest.raises(SubsetError, match=rf"sneaky\d\.py:\d+: .*{says}"):
        _ = served(line).files


def test_what_a_service_may_do_is_part_of_what_its_code_is_kept_by(served, monkeypatch):
    line = ALLOWED[1]
    firmware = served(line)
    assert firmware.files
    (name,) = firmware.services
    monkeypatch.setitem(SERVICES, name, replace(SERVICES[name], stores=()))
    with pytest.raises(SubsetError, match="stores in the loop's none only"):
        _ = replace(firmware).files


def test_a_package_may_be_named_as_its_module(tmp_path, monkeypatch):
    folder = tmp_path / "lamp"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "lamp_state.py").write_text(STATE.replace("Sneaky", "Lamp"))
    text = MODULE.format(package="lamp", line="sneaky.n = 2").replace("sneaky", "lamp")
    (folder / "lamp.py").write_text(text.replace("Sneaky", "Lamp"))
    monkeypatch.syspath_prepend(tmp_path)
    kind = Service(modules="lamp", records={"lamp": "lamp_state.Lamp"})
    monkeypatch.setitem(SERVICES, "lamp", kind)
    assert "canroll_lamp.c" in with_services(built_in(), ("lamp",)).files


def test_a_module_of_the_loop_is_not_replaced(tmp_path, monkeypatch):
    folder = tmp_path / "greedy"
    folder.mkdir()
    for name in ("__init__", "greedy", "ecu"):
        (folder / f"{name}.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(SERVICES, "greedy", Service(modules="greedy"))
    with pytest.raises(CanrollError, match=r"service greedy: another module is named ecu\.py"):
        with_services(built_in(), ("greedy",))


def test_a_service_stores_in_no_record_of_another(served, monkeypatch):
    firmware = served(ALLOWED[0])
    (name,) = firmware.services
    monkeypatch.setitem(SERVICES, name, replace(SERVICES[name], records={}))
    with pytest.raises(SubsetError, match="stores in sneaky"):
        _ = replace(firmware).files
