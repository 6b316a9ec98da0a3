"""What the 14-DOF car holds over a step: its inputs and what follows from them."""

from math import cos, sin

from canroll.typing import Vector
from plant_sim.bodies import ports
from plant_sim.bodies.parameters import (
    P_CORNERING,
    P_DISTANCE,
    P_MASS,
    P_STATIC,
    P_TRACK,
    P_UNLOADED,
)
from plant_sim.kernels.jit import inlined
from vehicles import GRAVITY

# The inputs' slots come first, then the vertical in the heading frame and that frame's turn per
# yaw rate about its own x and y.
UP = ports.N_INPUTS
TURN = UP + 3
# Slots of four wheels: place ahead of P, to the left of the middle (m); steering; radius without
# load; inverse of the static load; cornering stiffness; drive force (N).
DISTANCE, SIDE, STEER_COS, STEER_SIN, UNLOADED, PER_STATIC, CORNERING, DRIVE = range(
    TURN + 2, TURN + 34, 4
)
N_HELD = TURN + 34


@inlined
def hold(inputs: Vector, p: Vector, held: Vector) -> None:
    """Fill ``held`` (N_HELD)."""
    for k in range(ports.N_INPUTS):
        held[k] = inputs[k]
    c_bank, s_bank = cos(inputs[ports.BANK]), sin(inputs[ports.BANK])
    c_grade, s_grade = cos(inputs[ports.GRADE]), sin(inputs[ports.GRADE])
    held[UP], held[UP + 1], held[UP + 2] = s_grade, s_bank * c_grade, c_bank * c_grade
    # bank and grade are held relative to the car: the frame turns about the vertical
    held[TURN], held[TURN + 1] = held[UP] / held[UP + 2], held[UP + 1] / held[UP + 2]
    drive_per_load = inputs[ports.DRIVE_FORCE] / (p[P_MASS] * GRAVITY)
    c_steer, s_steer = cos(inputs[ports.STEER]), sin(inputs[ports.STEER])
    for wheel in range(4):
        axle = wheel // 2
        held[DISTANCE + wheel] = p[P_DISTANCE + axle]
        held[SIDE + wheel] = p[P_TRACK + axle] if wheel % 2 == 0 else -p[P_TRACK + axle]
        held[STEER_COS + wheel] = c_steer if axle == 0 else 1.0
        held[STEER_SIN + wheel] = s_steer if axle == 0 else 0.0
        held[UNLOADED + wheel] = p[P_UNLOADED + axle]
        held[PER_STATIC + wheel] = 1.0 / p[P_STATIC + axle]
        held[CORNERING + wheel] = p[P_CORNERING + axle]
        # traction is shared by static load
        held[DRIVE + wheel] = drive_per_load * p[P_STATIC + axle]
