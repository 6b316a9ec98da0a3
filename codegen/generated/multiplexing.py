"""Multiplexed frames: the selector of a message, and which of its pages a mailbox uses.

The firmware supports simple multiplexing: one selector, each other signal on one page or on all.
A receiving mailbox accepts one page and ignores frames of all others, so that its age is that of
the page. A sending one sets the selector to the page of its signals; only the diagnostics send
several pages, in turn.
"""

from collections.abc import Collection, Sequence

from cantools.database.can import Message

from canroll.codegen.frame.raw_signal import RawSignal, raw_signal
from canroll.codegen.generated.mapped_signal import MappedSignal
from canroll.errors import CanrollError


def selector(
    message: Message, used: Collection[str], where: str, *, sent: bool
) -> RawSignal | None:
    """Return the selector of the pages that signals in use are on, None where they are on none.

    Of a received frame only the signals in ``used`` count, of a sent one all.

    Raises:
        CanrollError: extended multiplexing, or a selector that is not unsigned.
    """
    signals = {signal.name: signal for signal in message.signals}
    selectors = [signal.name for signal in message.signals if signal.is_multiplexer]
    paged = [s for s in message.signals if s.multiplexer_ids and (sent or s.name in used)]
    first = None
    for signal in paged:
        above = signals.get(signal.multiplexer_signal or "")
        first = first or above
        nested = above is None or above.multiplexer_ids or above is not first
        if nested or len(signal.multiplexer_ids) > 1 or (sent and len(selectors) > 1):
            raise CanrollError(
                f"{where}: {message.name} has extended multiplexing (at {signal.name}); only one "
                "selector with one value per signal is supported"
            )
    if first is None:
        return None
    if first.is_signed or first.is_float:
        raise CanrollError(f"{where}: the selector {first.name} must be unsigned")
    return raw_signal(first)


def all_pages(message: Message) -> tuple[int, ...]:
    """The values of the selector that the message defines."""
    ids = {page for signal in message.signals for page in signal.multiplexer_ids or ()}
    return tuple(sorted(ids))


def pages(mapped: Sequence[MappedSignal]) -> tuple[int, ...]:
    """The pages that the signals in use are on; empty where all are on every page."""
    return tuple(sorted({signal.page for signal in mapped if signal.page is not None}))


def refuse_several(message: Message, chosen: tuple[int, ...], where: str) -> None:
    """Raise CanrollError where a single-page mailbox has signals on several pages."""
    if len(chosen) > 1:
        raise CanrollError(
            f"{where}: the signals are on pages {', '.join(map(str, chosen))} of {message.name}, "
            "but a mailbox takes one page: map the signals of one page"
        )


def refuse_unset(message: Message, mapped: Sequence[MappedSignal], where: str) -> None:
    """Raise CanrollError where a frame to be sent does not determine its page."""
    for signal in message.signals:
        if signal.is_multiplexer and signal.name in {its.name for its in mapped}:
            raise CanrollError(
                f"{where}: {signal.name} is the selector: it is set to the page that is sent; "
                "take it out of the map"
            )
    if all_pages(message) and not pages(mapped):
        raise CanrollError(
            f"{where}: {message.name} is multiplexed: map a signal of the page to be sent"
        )
