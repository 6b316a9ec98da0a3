"""The modes of a linear plant, each named by the motion with the largest participation.

A state's participation in a mode is |left × right eigenvector|, which is dimensionless, so that
angles, speeds and pressures can be compared. A state belongs to the first motion below whose
outputs depend on it.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world.linearise import LinearPlant

_AT_REST = 1e-6  # 1/s: a pole slower than that is no motion that anything would show
_MOTIONS = {
    "speed": (ports.VX,),
    "sideslip": (ports.VY,),
    "yaw": (ports.YAW_RATE,),
    "roll": (ports.ROLL, ports.ROLL_RATE),
    "pitch": (ports.PITCH, ports.PITCH_RATE),
    "heave": (ports.HEAVE, ports.HEAVE_RATE),
    "wheel spin": tuple(range(ports.WHEEL_SPEED, ports.WHEEL_SPEED + 4)),
    "front axle": tuple(
        slot + side for slot in (ports.TRAVEL, ports.TRAVEL_RATE) for side in (0, 1)
    ),
    "rear axle": tuple(
        slot + side for slot in (ports.TRAVEL, ports.TRAVEL_RATE) for side in (2, 3)
    ),
    "tyre slip": tuple(range(ports.LATERAL_FORCE, ports.LATERAL_FORCE + 4)),
    "bar": tuple(range(ports.BAR_MOMENT, ports.BAR_PRESSURE + 2)),
}
_FIRST_TRAVEL = {"front axle": ports.TRAVEL, "rear axle": ports.TRAVEL + 2}
OTHER = "other"
"""Motion of states that no output shows directly."""


@dataclass(frozen=True, slots=True)
class Mode:
    """One real pole, or a pair of conjugate ones.

    Attributes:
        shares: the two motions with the largest participation, largest first, and their fractions
            of the total; an axle's is "hop" (both wheels in phase) or "tramp".
        pole: the pole with an imaginary part >= 0 (1/s).
    """

    shares: tuple[tuple[str, float], ...]
    pole: complex

    @property
    def motion(self) -> str:
        """The dominant motion."""
        return self.shares[0][0]

    @property
    def frequency(self) -> float:
        """Undamped natural frequency (Hz)."""
        return abs(self.pole) / (2 * pi)

    @property
    def damping(self) -> float:
        """Damping ratio: 1 for a real pole, below 0 for an unstable mode."""
        return -self.pole.real / abs(self.pole)


def modes(plant: LinearPlant) -> list[Mode]:
    """Return the modes of ``plant``, slowest first, without poles at 0."""
    poles, right = np.linalg.eig(plant.a)
    participation = np.abs(right * np.linalg.pinv(right).T)
    participation /= participation.sum(axis=0)
    states = _states(plant)
    motions = []
    for i in np.flatnonzero((poles.imag >= 0.0) & (np.abs(poles) > _AT_REST)):
        outputs = plant.c @ right[:, i]
        # rounded, so that of two equal shares the one named first is always taken
        shares = [
            (_sided(motion, outputs), round(float(participation[at, i].sum()), 6))
            for motion, at in states.items()
        ]
        most = sorted(shares, key=lambda item: -item[1])[:2]
        motions.append(Mode(tuple(most), complex(poles[i])))
    return sorted(motions, key=lambda mode: mode.frequency)


def _states(plant: LinearPlant) -> dict[str, list[int]]:
    """Return the states of each motion."""
    left = set(range(len(plant.a)))
    states = {}
    for motion, slots in _MOTIONS.items():
        shown = np.flatnonzero(plant.c[list(slots)].any(axis=0))
        states[motion] = sorted(left & set(shown.tolist()))
        left -= set(states[motion])
    return {**states, OTHER: sorted(left)}


def _sided(motion: str, outputs: NDArray[np.complex128]) -> str:
    """Distinguish an axle's hop and tramp by the travel of its two wheels."""
    if motion not in _FIRST_TRAVEL:
        return motion
    left, right = outputs[_FIRST_TRAVEL[motion] :][:2]
    return f"{motion} {'hop' if abs(left + right) > abs(left - right) else 'tramp'}"
