"""The fault language: everything that can fail in the world, singly and together.

From Python, for a world or for a run::

    from canroll.plant_sim.faults import parse

    faults = parse("Imu.RollRate=stuck@2:4 + front=dead@3")
    world = World(..., faults=faults)
    result = canroll.run("double_lane_change", faults=["Imu.RollRate=offset:0.2@1::0.5"])

:class:`Fault` is one fault as plain data, ``kinds.KINDS`` the table of all kinds.
"""

from canroll.plant_sim.faults.language import Fault, parse, parse_all, read_file

__all__ = ["Fault", "parse", "parse_all", "read_file"]
