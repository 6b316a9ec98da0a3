"""What the 14-DOF car holds over a step: its inputs and what follows from them."""

from math import cos, sin

from canroll.typing import Vector
from plant_sim.bodies import ports
from plant_sim.bodies.parameters import Car
from plant_sim.kernels.jit import inlined
from vehicles import GRAVITY

# The inputs' slots come first, then the vertical in the heading frame and that frame's turn per
# yaw rate about its own x and y.
UP = ports.N_INPUTS
TURN = UP + 3
# Slots of four wheels: cosine and sine of the steering angle, drive force (N). Toe by tables turns
# the wheels in each evaluation.
STEER_COS, STEER_SIN, DRIVE = range(TURN + 2, TURN + 14, 4)
N_HELD = TURN + 14


@inlined
def hold(inputs: Vector, car: Car, held: Vector) -> None:
    """Fill ``held`` (N_HELD)."""
    for k in range(ports.N_INPUTS):
        held[k] = inputs[k]
    c_bank, s_bank = cos(inputs[ports.BANK]), sin(inputs[ports.BANK])
    c_grade, s_grade = cos(inputs[ports.GRADE]), sin(inputs[ports.GRADE])
    held[UP], held[UP + 1], held[UP + 2] = s_grade, s_bank * c_grade, c_bank * c_grade
    # bank and grade are held relative to the car: the frame turns about the vertical
    held[TURN], held[TURN + 1] = held[UP] / held[UP + 2], held[UP + 1] / held[UP + 2]
    drive_per_load = inputs[ports.DRIVE_FORCE] / (car.mass * GRAVITY)
    c_steer, s_steer = cos(inputs[ports.STEER]), sin(inputs[ports.STEER])
    for wheel in range(4):
        held[STEER_COS + wheel] = c_steer if wheel < 2 else 1.0
        held[STEER_SIN + wheel] = s_steer if wheel < 2 else 0.0
        # traction is shared by static load
        held[DRIVE + wheel] = drive_per_load * car.load[wheel]
