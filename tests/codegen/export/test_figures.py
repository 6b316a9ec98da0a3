"""The README of a bundle has what its own code needs, or says what lacks for the figures."""

import shutil

import pytest

from canroll import dbc
from canroll.codegen.export import figures
from canroll.codegen.run import cortex, ecu_traffic
from canroll.codegen.run.bus_firmware import built_in, of_bus, with_services
from canroll.codegen.run.specialised import specialised
from canroll.codegen.worst_case.footprint import footprint

RECORD = ecu_traffic.random_calibration(7)
needs_gcc = pytest.mark.skipif(
    not shutil.which(figures.GCC), reason="needs arm-none-eabi-gcc (package gcc-arm-none-eabi)"
)


def rows(text):
    cells = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return {row[0]: int(row[1]) for row in cells if len(row) == 2 and row[1].isdigit()}


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("services", [(), ("xcp", "uds", "nvm", "nvm_uds")])
def test_figures_are_those_of_the_code(services):
    pytest.importorskip("capstone", reason="needs canroll[target]")
    served = with_services(built_in(), services)
    text = figures.table(RECORD, built_in(), served)
    its = rows(text)
    size = footprint(cortex.gcc_image("cortex-m4", built_in().files))
    assert its["code, bytes of flash"] >= size.text
    assert (its["code, bytes of flash"] == size.text) == (not services)
    assert its["`ecu`, bytes of RAM"] == size.state
    assert 0 < its["cycles of `canroll_receive`, bound"] < its["cycles of `canroll_tick`, bound"]
    assert its["stack of `canroll_tick`, bytes, bound"] > 0
    # 10 ms: two of Imu and the like, one of what comes more rarely
    period = its["cycles of these and the tick, bound"] - its["cycles of `canroll_tick`, bound"]
    assert its["receive interrupts in a period, most"] >= len(built_in().bus.received)
    assert period == (
        its["receive interrupts in a period, most"] * its["cycles of `canroll_receive`, bound"]
    )
    assert (
        ("`uds`, bytes of RAM" in its)
        == ("with the services" in " ".join(text.split()))
        == bool(services)
    )


@pytest.mark.slow
@needs_gcc
def test_specialised_code_has_its_own():
    pytest.importorskip("capstone", reason="needs canroll[target]")
    special = specialised(built_in(), RECORD)
    found = rows(figures.table(RECORD, special, special))["code, bytes of flash"]
    flags = cortex.optimisation_of(special)
    size = footprint(cortex.gcc_image("cortex-m4", special.files, optimisation=flags))
    assert found == size.text
    assert found != footprint(cortex.gcc_image("cortex-m4", special.files)).text


@pytest.mark.slow
@needs_gcc
def test_authentication_is_counted():
    pytest.importorskip("capstone", reason="needs canroll[target]")
    secured = of_bus(dbc.SECURED_PATH, dbc.SECURED_MAP)
    text = figures.table(RECORD, secured, secured)
    assert rows(text)["`secoc`, bytes of RAM"] > 0
    assert "verifies at most one of each" in " ".join(text.split())


@pytest.mark.slow
def test_without_a_cross_compiler_the_sizes_are_those_of_clang(monkeypatch):
    pytest.importorskip("ziglang", reason="needs canroll[target]")
    monkeypatch.setattr(figures, "GCC", "no-such-gcc")
    text = figures.table(RECORD, built_in(), built_in())
    assert "no-such-gcc is not installed (package gcc-arm-none-eabi)" in " ".join(text.split())
    assert "clang" in text
    size = footprint(cortex.zig_image("cortex-m4"))
    assert rows(text)["code, bytes of flash"] == size.text
    assert not any("cycles" in name or "stack" in name for name in rows(text))


def test_without_any_compiler_it_says_which_package(monkeypatch):
    monkeypatch.setattr(figures, "GCC", "no-such-gcc")
    monkeypatch.setattr(cortex, "has_pip_tools", lambda: False)
    text = figures.table(RECORD, built_in(), built_in())
    assert "no-such-gcc is not installed (package gcc-arm-none-eabi)" in text
    assert rows(text) == {}
