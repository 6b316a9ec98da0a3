"""Small programs in assembly, linked for a Cortex-M; the firmware's image on an emulator."""

import shutil
import subprocess

import pytest

from canroll.codegen.run import cortex

pytest.importorskip("capstone", reason="needs canroll[target]")


@pytest.fixture
def assembled(tmp_path):
    """Link assembly text; each ``.global`` function needs its ``.type``."""
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("needs gcc-arm-none-eabi")
    from canroll.codegen.worst_case.machine_code import MachineImage

    def link(text, cpu="cortex-m4"):
        head = ".syntax unified\n.thumb\n.text\n"
        (tmp_path / "code.s").write_text(head + text, encoding="ascii")
        command = ["arm-none-eabi-gcc", f"-mcpu={cpu}", "-mthumb", "-nostdlib", "-Ttext=0x100"]
        command += ["-Wl,-e,main", "-o", "code.elf", "code.s", "-lgcc"]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
        return MachineImage(tmp_path / "code.elf")

    return link


@pytest.fixture(
    params=("cortex-m0", pytest.param("cortex-m3", marks=pytest.mark.long), "cortex-m4")
)
def cpu(request):
    """Each processor, where the firmware can be built for it."""
    if not cortex.has_gcc_and_qemu():
        pytest.skip("needs gcc-arm-none-eabi and qemu-system-arm")
    return request.param
