"""What the slow balance of the body may have left over, as shares: the largest over the box.

Springs that bear what acts show K, moments M are reported, m h a_y = L is measured. Of a car with
μ times the nominal mass and height, κ times the stiffness and moments of m times the reported ones
κ K = μ L + m M. A law's moments oppose the lateral force and are no larger.
"""

from collections.abc import Iterator

from gain_gen.monitors.uncertainty import Uncertainty, vertices

Corner = tuple[float, float, float]


def corners(box: Uncertainty) -> Iterator[Corner]:
    """Yield μ, κ and m at the corners of the box."""
    for factors in vertices(box, ("mass", "height", "stiffness")):
        for moment in (1.0 - box.moment, 1.0 + box.moment):
            yield factors.mass * factors.height, factors.stiffness, moment


def of_moments(box: Uncertainty) -> tuple[float, float, float]:
    """Return the shares where it judges the moments by the lateral force.

    K − L − M = (μ/κ − 1) L + (m/κ − 1) M: of L where that is to the side of L and where it is to
    the other, and of M.
    """
    own = max(mu / kappa for mu, kappa, _ in corners(box)) - 1.0
    other = 1.0 - min(mu / kappa for mu, kappa, _ in corners(box))
    # with M = −L, the largest there is
    besides = max(
        max((mu - moment) / kappa - own, (moment - mu) / kappa - other)
        for mu, kappa, moment in corners(box)
    )
    return own, other, max(0.0, besides)


def of_lateral(box: Uncertainty) -> tuple[float, float, float]:
    """Return the shares where it judges the lateral acceleration by what the body shows.

    S = K − M shows L: S − L = (1 − κ/μ) S + (m − κ)/μ M: of S where that is to the side of S and
    where it is to the other, and of M.
    """
    ends = [
        (1.0 - kappa / mu, (m - kappa) / mu, (mu + kappa - m) / kappa)
        for mu, kappa, m in corners(box)
    ]
    own, other = max(a for a, _, _ in ends), -min(a for a, _, _ in ends)
    # with M = −L, the largest there is, and S by it
    besides = max(max((a - own) * s - b, (-a - other) * s + b) for a, b, s in ends)
    return own, other, max(0.0, besides)
