"""The bundle passes its own tests on 32-bit machines of both byte orders, run by QEMU."""

import shutil
import subprocess

import pytest
from support.bundles import export

from canroll import dbc, vehicles
from canroll.cli import export_c
from canroll.codegen.export import a2l, bundle
from canroll.codegen.export.header import gains_header
from canroll.codegen.generated import signals
from canroll.codegen.generated.bus_map import XcpFrames
from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import of_bus
from canroll.extensions.services.xcp_description import described
from canroll.gain_gen.calibration import calibration_file

pytestmark = pytest.mark.long

RECORD = ecu_traffic.random_calibration(7)
MACHINES = {
    "big-endian": ("powerpc-linux-gnu-gcc", "qemu-ppc", "gcc-powerpc-linux-gnu"),
    "little-endian": ("arm-linux-gnueabihf-gcc", "qemu-arm", "gcc-arm-linux-gnueabihf"),
}
"""By byte order: compiler, emulator, and the package of the compiler."""
FLAGS = (
    "-std=c99",
    "-O2",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wsign-conversion",
    "-Werror",
    "-DCANROLL_PUBLIC_KEY",
)
MAIN = """
int main(void);
extern const canroll_calibration calibration;
const canroll_calibration calibration = CANROLL_CALIBRATION_INITIALISER;
unsigned char ecu = 1;
int main(void) { return calibration.law + ecu; }
"""
BUNDLES = {
    "general": {},
    "specialised": {"specialised": True},
    "secured": {"dbc": dbc.SECURED_PATH, "map_file": dbc.SECURED_MAP},
    "served": {"services": ("xcp", "uds", "nvm", "nvm_uds")},
}


@pytest.fixture(scope="module", params=BUNDLES)
def folder(request, tmp_path_factory):
    path = tmp_path_factory.mktemp(request.param)
    changes = {"dbc": signals.DBC, "map_file": signals.MAP, **BUNDLES[request.param]}
    bus = of_bus(changes["dbc"], changes["map_file"]).bus
    traffic = ecu_traffic.random_traffic(3, 100, hostile=0.3, bus=bus)
    bundle.write(path, export(RECORD, traffic=traffic, **changes))
    return path


def compiled(folder, order, *words, cwd=None):
    """Run the compiler for a machine on files of a bundle; skip where a tool lacks."""
    compiler, emulator, package = MACHINES[order]
    if not shutil.which(compiler) or not shutil.which(emulator):
        pytest.skip(f"needs {compiler} and {emulator} (packages {package} and qemu-user)")
    include = [f"-I{folder / 'include'}", f"-I{folder / 'test'}"]
    command = [compiler, *FLAGS, *include, *words]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def built(folder, files, order, image):
    """Build a program for a machine; return the command that runs it."""
    compiled(folder, order, "-static", "-o", image, *files)
    return [MACHINES[order][1], image]


@pytest.mark.parametrize("order", MACHINES)
def test_every_program_of_the_bundle_passes(folder, order, tmp_path):
    passed = set()
    runner = folder / "test" / "test_session.c"
    compiled(folder, order, "-c", *sorted((folder / "src").glob("*.c")), runner, cwd=tmp_path)
    objects = sorted(tmp_path.glob("*.o"))
    for session in sorted((folder / "test").glob("session_*.c")):
        command = built(folder, [*objects, session], order, tmp_path / session.stem)
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, f"{session.stem}: {ran.stdout}"
        assert ran.stdout.startswith("PASS: ")
        passed.add(session.stem)
    assert {"session_vectors", "session_cases"} <= passed


def tables():
    """Return the other tables of a calibration file: a vehicle, and empty values."""
    names = calibration_file.TABLES - {"schema", "calibration", "digest"}
    made = {name: {} for name in names}
    for name, kinds in calibration_file.NEEDED.items():
        made[name] = {key: kind[0]() for key, kind in kinds.items()}
    van = vehicles.load("van_real")
    made["design"]["vehicle"] = van.reference
    made["provenance"]["vehicle_sha256"] = van.fingerprint
    made["vehicle"] = van.document
    return made


@pytest.mark.parametrize("order", MACHINES)
def test_an_image_says_the_byte_order_of_a2l_and_flash(order, tmp_path):
    bincopy = pytest.importorskip("bincopy", reason="needs canroll[target]")
    (tmp_path / "src").mkdir()
    program = tmp_path / "main.c"
    program.write_text(gains_header(RECORD, title=["sample"]) + MAIN)
    _, image = built(tmp_path, [program], order, tmp_path / "main")
    (tmp_path / "canroll.a2l").write_text(a2l.a2l(a2l.Software("test", RECORD)))
    assert "BYTE_ORDER MSB_LAST\n" in (tmp_path / "canroll.a2l").read_text()
    calibration = tmp_path / "calibration.toml"
    calibration_file.save(calibration, RECORD, tables())
    assert export_c.address(tmp_path, image, str(calibration)) == 0
    word = "MSB_FIRST" if order == "big-endian" else "MSB_LAST"
    assert f"BYTE_ORDER {word}\n" in (tmp_path / "canroll.a2l").read_text()
    flash = bincopy.BinFile(str(tmp_path / "calibration.hex"))
    assert flash.minimum_address == a2l.addresses(image)["calibration"]
    assert bytes(flash.as_binary()) in image.read_bytes()


def test_the_order_is_an_option_of_an_export_without_an_image(tmp_path):
    base = {"calibration": 0x1000, "ecu": 0x2000}
    software = a2l.Software(
        "test", RECORD, XcpFrames(0x6F0, 0x6F1, 500_000), slave=described(RECORD.tick_us)
    )
    little, big = (a2l.a2l(software, base, order) for order in ("little", "big"))
    assert big == little.replace("  BYTE_ORDER MSB_LAST\n", "  BYTE_ORDER MSB_FIRST\n")
    # numbers in commands are little-endian on every target
    assert "BYTE_ORDER_MSB_LAST ADDRESS_GRANULARITY_BYTE" in big
    assert a2l.ordered(big, "little") == little
