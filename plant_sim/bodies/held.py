"""What the 14-DOF car holds over a step: its inputs and what follows from them."""

from math import cos, sin

from canroll.typing import Vector
from plant_sim.bodies import curves, ports
from plant_sim.bodies.parameters import Car
from plant_sim.kernels.jit import inlined
from vehicles import GRAVITY

# The inputs' slots come first, then the vertical in the heading frame and that frame's turn per
# yaw rate about its own x and y.
UP = ports.N_INPUTS
TURN = UP + 3
# Slots of four wheels: angle by the steering alone, its cosine and sine, drive force (N). Toe by
# tables and what the steering gives way turn the wheels in each evaluation.
STEERED, STEER_COS, STEER_SIN, DRIVE = range(TURN + 2, TURN + 18, 4)
N_HELD = TURN + 18


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
    for wheel in range(4):
        angle = 0.0
        if wheel < 2:
            side = 1.0 - 2.0 * wheel
            angle = curves.road_wheel(car.axle[0], car.points, inputs[ports.STEER], side)
        held[STEERED + wheel] = angle
        held[STEER_COS + wheel], held[STEER_SIN + wheel] = cos(angle), sin(angle)
        # traction is shared by static load
        held[DRIVE + wheel] = drive_per_load * car.load[wheel]
