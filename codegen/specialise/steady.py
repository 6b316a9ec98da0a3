"""Elements of the state that never change once the ECU has started.

Options that are off leave much of the state as ``init`` made it. All of it is taken to be so, the
tick is specialised on that ground, and whatever it then stores another value in is taken back,
until nothing is: what is left is a value that holds at the start and that every tick keeps.
"""

from collections.abc import Mapping

from codegen.specialise.evaluator import Evaluator
from codegen.specialise.places import STATE_RECORD, Element
from codegen.subset.program import Function, Program

REFUSAL = "refused"
"""Of an ECU that refuses its calibration this alone is read, and it is not as after a start."""


def steady(
    program: Program,
    entries: Mapping[str, Function],
    calibration: Mapping[Element, int],
    started: Mapping[Element, int],
    results: Mapping[tuple[str, str], int],
) -> dict[Element, int]:
    """Return the elements of the state that stay as ``started`` has them.

    Args:
        program: of the entry points.
        entries: ``tick``, which runs once a period, and ``receive``, which may run at any time.
        calibration: every element of it.
        started: every element of the state after ``init``.
        results: as of :class:`Evaluator`.
    """
    fields = program.record(STATE_RECORD).fields
    held = {
        (name, indices): value
        for (name, indices), value in started.items()
        if name != REFUSAL and not fields[name].volatile
    }
    interrupt = Evaluator(program, calibration, {}, results)
    interrupt.entry(entries["receive"])
    while True:
        evaluator = Evaluator(program, calibration, held, results)
        evaluator.entry(entries["tick"])
        changed = {
            element
            for store in (*interrupt.stores, *evaluator.stores)
            for element in store.elements
            if element in held and store.value != held[element]
        }
        if not changed:
            return held
        held = {element: value for element, value in held.items() if element not in changed}
