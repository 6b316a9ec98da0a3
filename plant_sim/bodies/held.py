"""What the 14-DOF car holds over a step: its inputs and what follows from them."""

from math import cos, sin

from canroll.plant_sim.bodies import curves, ports
from canroll.plant_sim.bodies.parameters import Car
from canroll.plant_sim.kernels.jit import inlined
from canroll.typing import Vector
from canroll.vehicles import GRAVITY

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
    left, right = inputs[ports.STEER], inputs[ports.STEER]
    if car.axle[0].rows[curves.STEERING] > 0.0:
        left = curves.road_wheel(car.axle[0], car.points, left, 1.0)
        right = curves.road_wheel(car.axle[0], car.points, right, -1.0)
    held[STEERED], held[STEERED + 1] = left, right
    held[STEER_COS], held[STEER_SIN] = cos(left), sin(left)
    held[STEER_COS + 1], held[STEER_SIN + 1] = held[STEER_COS], held[STEER_SIN]
    if right != left:
        held[STEER_COS + 1], held[STEER_SIN + 1] = cos(right), sin(right)
    for wheel in range(2, 4):
        held[STEERED + wheel], held[STEER_COS + wheel], held[STEER_SIN + wheel] = 0.0, 1.0, 0.0
    for wheel in range(4):
        # traction is shared by static load
        held[DRIVE + wheel] = drive_per_load * car.load[wheel]
