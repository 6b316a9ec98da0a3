"""The bundle for a network with the defects of real cars' files is that of one without them."""

import cantools
import pytest
from support import rough_bus
from support.bundles import compared, export, make

from canroll.codegen.export import bundle
from canroll.codegen.generated import bus_map
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import of_bus


def test_its_map_warns_once_of_what_is_wrong(tmp_path):
    (warning,) = bus_map.load(*rough_bus.write(tmp_path)).warnings
    for defect in (
        'CM_ SG_ 257 "name missing";',
        "BO_ 1073741900 TP_01: 8 Brakes",
        'VAL_ 257 GY_Absent 0 "aus";',
        'VAL_ 3221225472 Lonely 0 "aus";',
        "taken as extended 0x18FEF001 (BRAKE_05)",
        "SUSP_02 and SUSP_OLD have the identifier 0x192",
        "overlapping in message ACT_01",
    ):
        assert defect in warning
    assert "\n" not in warning


def test_its_firmware_is_that_of_the_network_without_defects(tmp_path):
    own = of_bus(rough_bus.OWN / "own.dbc", rough_bus.OWN / "own.toml").files
    rough = of_bus(*rough_bus.write(tmp_path)).files
    assert {n: text.replace("rough.dbc", "own.dbc") for n, text in rough.items()} == own


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_its_bundle_passes_and_agrees_with_cantools(tmp_path):
    dbc, map_file = rough_bus.write(tmp_path)
    folder = tmp_path / "bundle"
    bundle.write(folder, export(dbc=dbc, map_file=map_file))
    copy = cantools.database.load_file(folder / "rough.dbc", strict=False)
    assert copy.get_message_by_name("GYRO_01").comment == "Gierrate über Achse"
    done = make(folder, "test", "CFLAGS=-std=c99 -O1 -Wall -Werror")
    assert done.returncode == 0, done.stdout + done.stderr
    done = compared(folder, 2000)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS") == 7 and done.stderr == ""
