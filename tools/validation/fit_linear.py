"""Known truth without a search: whether intervals are wide enough where errors are small.

``python -m tools.validation.fit_linear COUNT [FACTOR]`` prints the table of
:mod:`tools.validation.fit_truth` for the same logs, with FACTOR times the noise of their sensors
(default: 1) but the same noise of steering and speed. One Gauss-Newton step from the true numbers
is the estimate, which neither curvature nor another minimum can spoil: what remains is the
covariance.
"""

import sys

import numpy as np

from canroll.extensions.car.identification import unknowns
from canroll.extensions.car.identification.information import (
    IDENTIFIED,
    felt,
    fisher_at,
    information,
)
from canroll.extensions.car.identification.output_error import Model, Point, Simulator, weights
from canroll.extensions.car.identification.pieces import EVERYTHING, pieces
from tools.validation.fit_truth import NAMES, NOISE, Outcome, log_of, outcome_of, table, truth


def outcome(seed: int, factor: float) -> Outcome:
    """Estimate the numbers of one log and compare with its truth."""
    case = truth(seed, noise={name: factor * noise for name, noise in NOISE.items()})
    parts, _ = pieces(log_of(case), EVERYTHING)
    sought = unknowns.unknowns(case.start, NAMES)
    simulator = Simulator(Model(case.start, parts, "body", EVERYTHING, sought))
    x = np.array([unknown.coordinate(case.numbers[unknown.key]) for unknown in sought])
    white, times = weights(simulator, x)
    point = Point(x, 0.0, white * np.sqrt(times))
    free = felt(fisher_at(simulator, point))
    slopes = (simulator.slopes(x) / point.scale[:, None]).reshape(-1, x.size)
    # those that the log does not tell are held at their priors
    left = (simulator.residuals(x) / point.scale).ravel() - slopes[:, ~free] @ x[~free]
    normal = slopes[:, free].T @ slopes[:, free] + np.eye(int(free.sum()))
    errors = -x
    errors[free] = -np.linalg.solve(normal, slopes[:, free].T @ left + x[free])
    content = information(simulator, point)
    covariance = content.covariance(free)
    states = np.where(np.diag(covariance) < IDENTIFIED, "identified", "together")
    named = zip((u.key for u in sought), np.where(free, states, "kept").tolist(), strict=True)
    return outcome_of(list(named), errors, covariance, content.least(free))


def main(arguments: list[str]) -> int:
    """Run the command; return the exit code."""
    match arguments:
        case [count] | [count, _] if count.isdecimal():
            factor = float(arguments[1]) if arguments[1:] else 1.0
            outcomes = [outcome(seed, factor) for seed in range(1, int(count) + 1)]
            print("\n".join(table(outcomes)))
            return 0
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
