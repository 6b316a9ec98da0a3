"""Mutation test of the firmware: change one operator or constant, and the tests must fail.

    python -m tools.mutation [MODULE ...] [--sample N] [--seed S] [--jobs J]

Every mutant is tested by the quick tests of tests/firmware that run the changed line, and by the
proof of no overflow; a killed one failed at least one of them. Mutants that translate to the same
machine code as the original, or differ from it only for values proved not to occur, are equivalent
and do not count. Survivors are listed, with the reason if there is one in survivors.toml.
"""

import argparse
import os
import random
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from canroll.errors import CanrollError, UnknownNameError
from tools.mutation.hunt import EQUIVALENT, KILLED, REFUSED, SURVIVED, Outcome, run
from tools.mutation.mutants import Mutant, all_mutants, sources
from tools.progress import progress

REASONS = Path(__file__).with_name("survivors.toml")
WANTED = 0.95


def sample(mutants: Sequence[Mutant], size: int, seed: int) -> list[Mutant]:
    """Return ``size`` mutants, evenly spread over modules and functions."""
    step = max(1.0, len(mutants) / size)
    start = random.Random(seed).uniform(0, step)
    return [mutants[int(start + k * step)] for k in range(min(size, len(mutants)))]


def share(outcomes: Iterable[Outcome]) -> float:
    """Return the fraction of killed mutants among those that are not equivalent."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    counted = counts[KILLED] + counts[SURVIVED]
    return counts[KILLED] / counted if counted else 1.0


def reasons() -> list[tuple[str, str, str]]:
    """Place, changed line and reason of the survivors in survivors.toml.

    The place is a function, or a module if the line is a constant of it.
    """
    found = []
    for module, places in tomllib.loads(REASONS.read_text(encoding="utf-8")).items():
        for name, its in places.items():
            if isinstance(its, str):
                found.append((module, name, its))
            else:
                found += [(f"{module}.{name}", text, reason) for text, reason in its.items()]
    return found


def report(outcomes: Sequence[Outcome], exist: int) -> str:
    """Return the figures by module, the survivors with their reasons, the equivalent mutants."""
    known = {(place, text): reason for place, text, reason in reasons()}
    lines = [f"{'module':<16}{'mutants':>8}{'equivalent':>12}{'killed':>8}{'survived':>10}"]
    for module in dict.fromkeys(outcome.mutant.module for outcome in outcomes):
        its = Counter(o.verdict for o in outcomes if o.mutant.module == module)
        figures = f"{its[EQUIVALENT]:>12}{its[KILLED]:>8}{its[SURVIVED]:>10}"
        lines.append(f"{module:<16}{its.total():>8}{figures}")
    for verdict in (SURVIVED, EQUIVALENT):
        chosen = [outcome for outcome in outcomes if outcome.verdict == verdict]
        lines += ["", f"{verdict}: {len(chosen)}"]
        for outcome in chosen:
            mutant = outcome.mutant
            why = outcome.by or known.get((mutant.place, mutant.text), "no reason known")
            lines += [f"{mutant}: {mutant.text}", f"    {why}"]
    counts = Counter(outcome.verdict for outcome in outcomes)
    counted = len(outcomes) - counts[EQUIVALENT]
    lines += ["", f"{counts[KILLED]} of {counted} mutants killed ({share(outcomes):.1%})"]
    lines[-1] += f", {counts[EQUIVALENT]} equivalent ones left out; {exist} exist"
    refused = sum(o.by.startswith(REFUSED) for o in outcomes if o.verdict == KILLED)
    lines += [f"{refused} of the killed by the translation or its proof, all others by tests"]
    return "\n".join(lines)


def main() -> int:
    """Run a sample or all mutants; 1 if fewer than 95 % are killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="default: all")
    parser.add_argument("--sample", type=int, help="how many mutants (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    texts = sources()
    every = all_mutants(texts)
    modules = sorted({mutant.module for mutant in every})
    try:
        for name in arguments.modules:
            if name not in modules:
                raise UnknownNameError("module", name, modules)
        every = [m for m in every if m.module in (arguments.modules or modules)]
        size = arguments.sample if arguments.sample is not None else len(every)
        if size < 1 or arguments.jobs < 1:
            raise CanrollError("--sample and --jobs must be at least 1")
        chosen = sample(every, size, arguments.seed)
        with progress("mutants", len(chosen)) as more:
            outcomes = run(chosen, texts, arguments.jobs, lambda: more(1))
    except CanrollError as error:
        print(f"mutate: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("mutate: interrupted", file=sys.stderr)
        return 130
    print(report(outcomes, len(every)))
    return 0 if share(outcomes) >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
