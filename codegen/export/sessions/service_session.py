"""The test of a service in a bundle: a session, answered by the reference, and its runner."""

from collections.abc import Callable, Iterator, Sequence
from importlib.resources import files

from codegen.run.backends import NativeEcu
from codegen.run.bus_firmware import BusFirmware
from codegen.run.served import ServedEcu
from firmware.calibration import Calibration

REST = 20
"""Ticks after the last frame to the ECU."""


def no_word(_: bytes) -> int:
    """Say of a frame that it has no word as memory has it."""
    return 0


def session_test(
    service: str,
    firmware: BusFirmware,
    record: Calibration,
    asked: Sequence[tuple[int, bytes]],
    heading: Sequence[str] = (),
    *,
    word_in: Callable[[bytes], int] = no_word,
) -> dict[str, str]:
    """Return the texts of the test by their places in the bundle.

    Args:
        service: its name; ``templates/test_NAME.c`` is the runner.
        firmware: the firmware with the service.
        record: the calibration.
        asked: frames to the ECU, each with the tick before which it arrives.
        heading: further lines of the header.
        word_in: where an answer has a word as memory has it, 0: nowhere.
    """
    ecu = ServedEcu(NativeEcu(record, firmware), record, firmware)
    its = ecu.services[service]
    answers = []
    waiting = dict(asked)
    ticks = asked[-1][0] + REST
    for tick in range(ticks):
        if tick in waiting:
            its.receive(waiting[tick])
        ecu.run()
        answers += [(tick, payload) for payload in its.take()]
    upper = service.upper()
    text = [
        f"/* A session of {upper}. */",
        "#include <stdint.h>",
        "",
        f"#define {upper}_TICKS {ticks}",
        f"#define {upper}_COMMANDS {len(asked)}",
        f"#define {upper}_ANSWERS {len(answers)}",
        *heading,
        "",
        "/* word: where the payload has a word as little-endian memory has it, 0: nowhere */",
        f"typedef struct {{ int32_t tick, length, word; uint8_t payload[8]; }} {service}_frame;",
        "",
        *_frames(service, "commands", asked, no_word),
        *_frames(service, "answers", answers, word_in),
    ]
    template = files("codegen.export").joinpath("templates", f"test_{service}.c")
    return {
        f"test/test_{service}.c": template.read_text(encoding="utf-8"),
        f"test/{service}_session.h": "\n".join([*text, ""]),
    }


def _frames(
    service: str,
    what: str,
    frames: Sequence[tuple[int, bytes]],
    word_in: Callable[[bytes], int],
) -> Iterator[str]:
    yield f"static const {service}_frame {service}_{what}[{len(frames)}] = {{"
    for tick, payload in frames:
        padded = ", ".join(str(byte) for byte in payload.ljust(8, b"\0"))
        yield f"    {{ {tick}, {len(payload)}, {word_in(payload)}, {{ {padded} }} }},"
    yield "};"
    yield ""
