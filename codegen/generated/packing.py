"""Subset code that packs the frames that the ECU sends: raw codes into words, pages in turn."""

from collections.abc import Iterable

from canroll.codegen.frame.raw_signal import RawSignal
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import IN_TURN, WORD, Mailbox
from canroll.codegen.generated.mapped_signal import MappedSignal
from canroll.codegen.generated.signal_code import (
    LINE,
    packed,
    placed,
    raw_name,
    wrapped,
)

STORE = '''\
def store(ecu: Ecu, message: i32, frame: i64) -> None:
    """Make the bytes of ``frame`` the payload of ``message``."""
    left: i64 = frame
    for k in range(8):
        ecu.tx_payload[message][k] = byte(left)
        left = left >> 8'''
STORE_WORD = '''\
def store_word(ecu: Ecu, message: i32, first: i32, value: i64) -> None:
    """Make ``value`` eight bytes of the payload of ``message``, from byte ``first`` on."""
    left: i64 = value
    for k in range(8):
        ecu.tx_payload[message][first + k] = byte(left)
        left = left >> 8'''


def pack(box: Mailbox) -> Iterable[str]:
    """Return the function that packs a frame that is sent."""
    yield f"def pack_{box.slot}(ecu: Ecu) -> {'None' if box.is_long else 'i64'}:"
    if not box.name:
        yield '    """Nothing on this bus takes the frame: it stays empty."""'
        yield "    return 0"
        return
    frame = box.frame_words
    yield f'    """{"Store" if box.is_long else "Return"} the frame {box.identified}."""'
    yield from (f"    {word}: i64 = 0" for word in frame)
    yield from _fill([signal for signal in box.signals if signal.page is None], frame, "    ")
    if box.selector is not None and box.slot == IN_TURN:
        yield from _pages_in_turn(box, box.selector)
    elif box.selector is not None:
        yield from _page(box, box.selector, box.pages[0], "    ")
    if not box.is_long:
        yield "    return frame"
        return
    for number, word in enumerate(frame):
        yield f"    store_word(ecu, TX_{box.slot.upper()}, {WORD * number}, {word})"


def _pages_in_turn(box: Mailbox, selector: RawSignal) -> Iterable[str]:
    """A branch for each page, selected by the number of the page that is due."""
    if len(box.pages) == 1:
        yield from _page(box, selector, box.pages[0], "    ")
        return
    in_order = box.pages == tuple(range(len(box.pages)))
    if in_order:
        yield f"    {raw_name(selector)}: i32 = ecu.diagnostics_page"
        yield from (f"    {line}" for line in placed(selector, box.frame_words))
    keyword = "if"
    for number, page in enumerate(box.pages):
        yield f"    {keyword} ecu.diagnostics_page == {number}:"
        keyword = "elif"
        if in_order:
            there = [its for its in box.signals if its.page == page]
            yield from _fill(there, box.frame_words, "        ")
        else:
            yield from _page(box, selector, page, "        ")


def _page(box: Mailbox, selector: RawSignal, page: int, indent: str) -> Iterable[str]:
    """The selector and the signals of one page."""
    yield f"{indent}{raw_name(selector)}: i32 = {page}"
    yield from (f"{indent}{line}" for line in placed(selector, box.frame_words))
    yield from _fill(
        [signal for signal in box.signals if signal.page == page], box.frame_words, indent
    )


def _fill(signals: list[MappedSignal], frame: tuple[str, ...], indent: str) -> Iterable[str]:
    """Put the raw codes of ``signals`` into the frame."""
    for signal in signals:
        name = raw_name(signal)
        yield from wrapped(f"{indent}{name}: i32 = {packed(signal)}", LINE)
        if signal.minus is not None:
            yield f"{indent}{raw_name(signal.minus)}: i32 = 0"
            yield f"{indent}if {name} < 0:"
            yield f"{indent}    {raw_name(signal.minus)} = 1"
            yield f"{indent}    {name} = -{name}"
        if signal.twin is not None:
            other = signal.twin.signal
            value = name
            if signal.twin.inverted:
                value = f"{-1 if other.signed else (1 << other.length) - 1} - {name}"
            yield f"{indent}{raw_name(other)}: i32 = {value}"
        for part in signal.parts:
            yield from (f"{indent}{line}" for line in placed(part, frame))


def dispatch_pack(bus: BusMap) -> Iterable[str]:
    """Return the function that packs the frame of a number."""
    yield "def pack(ecu: Ecu, message: i32) -> None:"
    yield '    """Pack the frame that is number ``message``."""'
    several = any(box.is_long for box in bus.transmitted)
    if not several:
        yield "    frame: i64 = 0"
    keyword = "if"
    for box in bus.transmitted:
        call = f"pack_{box.slot}(ecu)"
        if several and not box.is_long:
            call = f"store(ecu, message, {call})"
        yield f"    {keyword} message == TX_{box.slot.upper()}:"
        yield f"        {call if several else f'frame = {call}'}"
        keyword = "elif"
    if not several:
        yield "    store(ecu, message, frame)"
