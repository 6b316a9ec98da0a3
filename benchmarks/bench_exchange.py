"""ECU, plant and vehicle as FMUs beside the same without, and what XCP costs the ECU.

Every ratio is of CPU times in one run, both from C: an importer in C steps the FMUs, and the native
side is a batch in C or a compiled kernel. Medians of several pairs. Targets: frames of 100000 ticks
byte-identical and a tick at most 1.2 times the native one; plant and vehicle at least at 0.8 of
the speed of virtual time; twenty signals by XCP in at most 1500 instructions of a Cortex-M4.
"""

import argparse
import ctypes
import io
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path

import fmpy
import numpy as np

import vehicles
from canroll.cli.main import parse
from canroll.cli.timing import recorded
from canroll.extensions.exchange.cli import export_fmu
from canroll.extensions.exchange.fmu import archive
from canroll.runs.experiment import build_world, plan
from codegen.run import cortex, ecu_traffic, native
from codegen.run.bus_firmware import built_in
from codegen.run.memory_image import dtype, image
from firmware.calibration import Calibration
from plant_sim import bodies
from plant_sim.driving import maneuvers
from plant_sim.kernels.jit import njit
from plant_sim.world import open_loop

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.fmus import importer, transmit

TICK, RUN_TIME = 0.010, 0.0002


class Fmu:
    """An exported FMU unpacked, and the importer in C."""

    def __init__(self, folder, kind, *options):
        path = folder / f"{kind}.fmu"
        with redirect_stdout(io.StringIO()):
            export_fmu.run(parse(["export-fmu", kind, str(path), *options]))
        unpacked = fmpy.extract(str(path), str(folder / kind))
        described = fmpy.read_model_description(str(path))
        self.token = described.instantiationToken.encode()
        self.references = {its.name: its.valueReference for its in described.modelVariables}
        identifier = described.coSimulation.modelIdentifier
        library = Path(unpacked) / "binaries" / archive.machine() / f"{identifier}.so"
        self.library = str(library).encode()


def importer_in_c(folder):
    built = folder / "fmu_steps.so"
    source = Path(__file__).with_name("fmu_steps.c")
    command = [native.compiler(), "-O2", "-shared", "-fPIC", f"-I{archive.SOURCES}"]
    subprocess.run([*command, "-o", str(built), str(source)], check=True)
    library = ctypes.CDLL(str(built))
    library.fmu_steps.restype = library.fmu_ticks.restype = ctypes.c_double
    return library


def address(array):
    return ctypes.c_void_p(array.ctypes.data)


def timed(run):
    begin = time.thread_time()
    run()
    return time.thread_time() - begin


def ratios(pairs, one, other):
    """Median of one / other in pairs, each timed just after the other."""
    return float(np.median([one() / other() for _ in range(pairs)]))


def ecu(folder, steps, ticks, pairs):
    fmu = Fmu(folder, "ecu", "--law", "lqr")
    _, controller, traffic = recorded(parse(["timing", "--law", "lqr"]))
    record = np.frombuffer(image(controller.record), dtype(Calibration), 1).copy()
    # one drive after the other, as often as it takes
    frames = np.concatenate([traffic.frames] * -(-ticks // traffic.ticks))
    frames["tick"] += np.repeat(np.arange(0, ticks, traffic.ticks), len(traffic.frames))
    frames = frames[frames["tick"] < ticks]
    elapsed = np.ones(ticks, np.int32)
    boxes = built_in().bus.received
    starts = np.searchsorted(frames["tick"], np.arange(ticks + 1))
    operations = [
        transmit(boxes[f["message"]].ident, bytes(f["payload"][: f["length"]])) for f in frames
    ]
    ends = np.concatenate(([0], np.cumsum([len(each) for each in operations])))
    at = ends[starts].astype(np.int64)
    received = np.frombuffer(b"".join(operations), np.uint8)
    sent, sent_at = np.zeros(200 * ticks, np.uint8), np.zeros(ticks + 1, np.int64)
    port = np.array(
        [fmu.references[f"CAN.{name}"] for name in ("Rx_Clock", "Rx_Data", "Tx_Clock", "Tx_Data")],
        np.uint32,
    )

    def stepped():
        return steps.fmu_ticks(
            fmu.library,
            fmu.token,
            address(port),
            ctypes.c_int64(ticks),
            ctypes.c_double(TICK),
            ctypes.c_double(RUN_TIME),
            address(received),
            address(at),
            address(sent),
            address(sent_at),
        )

    library = native.library()
    batch = [ecu_traffic.EcuTraffic(frames, elapsed)]

    def native_run():
        ecus = library.start(record)
        return timed(lambda: library.replay(ecus, record, batch))

    ratio = ratios(pairs, stepped, native_run)
    answer = library.replay(library.start(record), record, batch).frames
    wanted = [(int(f["tick"]), boxes_of(f["message"]).ident, payload_of(f)) for f in answer]
    found = [
        (k, ident, data)
        for k in range(ticks)
        for ident, data in importer().frames_of(sent[sent_at[k] : sent_at[k + 1]].tobytes())
    ]
    assert found == wanted, "the frames differ"
    print(f"ECU: {len(found)} frames in {ticks} ticks      byte-identical")
    print(f"ECU: a tick with its frames / native     {ratio:8.2f}   (target 1.2)")
    print(f"ratio ecu {1.0 / ratio:.3f}")
    print(f"     native {1e6 * native_run() / ticks:.3f} us, FMU {1e6 * stepped() / ticks:.3f} us")


def boxes_of(message):
    return built_in().bus.transmitted[message]


def payload_of(frame):
    return bytes(frame["payload"][: boxes_of(frame["message"]).sent_length])


@njit
def kernel_steps(step, state, inputs, parameters, outputs, count):  # noqa: PLR0917
    for _ in range(count):
        step(state, inputs, parameters, outputs, 1e-3)


def vehicle(folder, steps, count, pairs):
    fmu = Fmu(folder, "vehicle")
    body, its = bodies.body("nonlinear"), vehicles.load("van_real")
    maneuver = maneuvers.build("double_lane_change", its, 80 / 3.6, 0)

    def kernel():
        start = open_loop.start(its, body, maneuver)
        return timed(lambda: kernel_steps(body.step, *start, count))

    kernel()
    ratio = stepping(fmu, steps, count, kernel, pairs)
    print(f"vehicle: speed / compiled kernel         {ratio:8.2f}   (target 0.8)")
    print(f"ratio vehicle {ratio:.3f}")


def plant(folder, steps, count, pairs):
    fmu = Fmu(folder, "plant", "--ports", "signals")
    settings, _ = plan("double_lane_change")

    def virtual_time():
        world = build_world(settings, enabled=False)
        world.advance(1_000_000)
        return timed(lambda: world.advance((count + 1) * 1_000_000))

    virtual_time()
    ratio = stepping(fmu, steps, count, virtual_time, pairs)
    print(f"plant: speed / virtual time with its bus {ratio:8.2f}   (target 0.8)")
    print(f"ratio plant {ratio:.3f}")


def stepping(fmu, steps, count, native_run, pairs):
    def stepped():
        return steps.fmu_steps(fmu.library, fmu.token, ctypes.c_int64(count), ctypes.c_double(1e-3))

    return ratios(pairs, native_run, stepped)


def xcp():
    if not cortex.has_pip_tools():
        print("XCP: left out: needs ziglang and unicorn (canroll[target])")
        return
    from support.xcp_machine import VALUES, Machine

    machine = Machine()
    idle = machine.tick()[0]
    machine.measure()
    counts = [machine.tick()[0] for _ in range(50)]
    print(f"XCP: {VALUES} signals every tick, instructions {max(counts):8d}   (target 1500)")
    print(f"     without a list {idle}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=6.0, help="simulated time a run")
    parser.add_argument("--pairs", type=int, default=5)
    args = parser.parse_args()
    count = round(args.seconds * 1000)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        steps = importer_in_c(folder)
        ecu(folder, steps, args.ticks, args.pairs)
        vehicle(folder, steps, count, args.pairs)
        plant(folder, steps, count, args.pairs)
    xcp()


if __name__ == "__main__":
    main()
