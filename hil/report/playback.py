"""What the playback on the page needs: the motion of each car, thinned to 50 a second."""

from collections.abc import Sequence

import numpy as np

from hil.report.curves import Shown
from hil.report.figure import pack
from plant_sim.bodies.ports import WHEELS
from vehicles import Vehicle

STEP = 0.02
SIGNALS = ("x", "y", "yaw", "roll", *(f"wheel_load_{wheel}" for wheel in WHEELS))


def playback(runs: Sequence[Shown], vehicle: Vehicle) -> dict[str, object]:
    """Return the data of the playback; at most four cars, the first being the reference."""
    cars = [
        {
            "name": run.name,
            "colour": run.colour,
            "signals": {name: pack(_resampled(run, name)) for name in SIGNALS},
        }
        for run in runs[:4]
    ]
    geometry = vehicle.geometry
    first = runs[0].trace.signals
    return {
        "step": STEP,
        "start": float(first["time"][int(np.argmax(np.abs(first["roll"])))]),
        "cars": cars,
        "vehicle": {
            "half_track": (geometry.half_track_front + geometry.half_track_rear) / 2,
            "width": geometry.width,
            "height": 2 * vehicle.sprung_cg_height,
            "roll_centre": (geometry.roll_centre_height_front + geometry.roll_centre_height_rear)
            / 2,
            "front": geometry.cg_to_front_axle,
            "rear": geometry.cg_to_rear_axle,
            "static_load": float(np.mean([first[f"wheel_load_{wheel}"][0] for wheel in WHEELS])),
        },
    }


def _resampled(run: Shown, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    time = run.trace.signals["time"]
    return np.interp(np.arange(0.0, time[-1], STEP), time, run.trace.signals[name])
