"""What the commands that measure a vehicle without control share: its options, and the vehicle."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plant_sim.bodies import Body
    from vehicles import Vehicle


def add_vehicle_options(parser: argparse.ArgumentParser) -> None:
    """Add which vehicle is measured, by which model, and that the answer is wanted as JSON."""
    parser.add_argument("--vehicle", default="van_real", help="default: %(default)s")
    parser.add_argument("--plant", default="nonlinear", help="default: %(default)s")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def vehicle_and_body(args: argparse.Namespace) -> "tuple[Vehicle, Body]":
    """Return the vehicle that is asked for and the model that it is driven by.

    Raises:
        CanrollError: a file that cannot be read.
        UnknownNameError: no such vehicle or model.
    """
    import vehicles  # noqa: PLC0415 - loads compiled kernels
    from plant_sim import bodies  # noqa: PLC0415

    return vehicles.load(args.vehicle), bodies.body(args.plant)
