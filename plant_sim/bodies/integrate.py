"""One classical Runge-Kutta step for every plant body."""

from collections.abc import Callable

from canroll.plant_sim.bodies.ports import STATES_MAX
from canroll.plant_sim.kernels.jit import njit, stack_vector
from canroll.typing import Vector

_room = stack_vector(STATES_MAX)


def rk4(derivative: Callable[..., None]) -> Callable[..., None]:
    """The step for one body's ``derivative(state, inputs, parameters, rate)``, a jitted function.

    The result advances ``state`` in place by ``dt`` (s) with the inputs held; fourth order. Built
    once per body, because numba cannot cache a caller that passes jitted functions.
    """

    def advance(state: Vector, inputs: Vector, parameters: Vector, dt: float) -> None:
        n = state.size
        trial, rate, total = _room()[:n], _room()[:n], _room()[:n]
        derivative(state, inputs, parameters, rate)
        for i in range(n):
            total[i] = rate[i]
            trial[i] = state[i] + 0.5 * dt * rate[i]
        derivative(trial, inputs, parameters, rate)
        for i in range(n):
            total[i] += 2.0 * rate[i]
            trial[i] = state[i] + 0.5 * dt * rate[i]
        derivative(trial, inputs, parameters, rate)
        for i in range(n):
            total[i] += 2.0 * rate[i]
            trial[i] = state[i] + dt * rate[i]
        derivative(trial, inputs, parameters, rate)
        for i in range(n):
            state[i] += dt / 6.0 * (total[i] + rate[i])

    # Machine code that different processes cached is linked by name: two bodies' steps of one name
    # would call each other.
    owner = derivative.__module__.rpartition(".")[2]
    advance.__name__ = advance.__qualname__ = f"advance_{owner}"
    return njit(advance)
