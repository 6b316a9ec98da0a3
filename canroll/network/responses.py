"""Response times and delays of a bus, from Python."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canroll.arguments import checked
from canroll.errors import UnknownNameError
from canroll.network import SENSOR
from canroll.network.analysis import AnalysisOptions
from canroll.network.answer import MS, Answer
from canroll.network.as_json import milliseconds
from canroll.network.recorded import Added, ExtendedLog
from canroll.network.sources import BusNetwork, TrafficSet
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.can_bus.network.network_file import is_network, load_profile
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.traffic.log_name import log_name
from canroll.table import Table

BUILT_IN = "500k"
"""The bus whose frames come onto that of a log."""


@dataclass(frozen=True, slots=True, repr=False)
class BusAnalysis:
    """Bounds and simulated times of a network, a traffic set, or every channel of a log.

    Attributes:
        answers: one of a network or traffic set, one for each channel of a log.
        json: the object printed by ``canroll bus --json``.
    """

    answers: tuple[Answer, ...]
    json: Mapping[str, Any]

    @property
    def good(self) -> bool:
        """Whether every message is bounded and no deadline is missed."""
        return not any(answer.failed for answer in self.answers)

    @property
    def table(self) -> Table:
        """One row for each message on each bus: bound and longest time seen or simulated, ms."""
        return Table(
            [
                {
                    "bus": segment.name,
                    "message": row.message.name,
                    "id": row.message.ident,
                    "period_ms": row.message.period_ns * MS,
                    "bound_ms": milliseconds(row.limit_ns(row.bound)),
                    "longest_ms": milliseconds(row.longest_ns),
                }
                for answer in self.answers
                for segment in answer.segments
                for row in segment.rows
            ]
        )

    def to_json(self) -> Mapping[str, Any]:
        """Return the object printed by ``canroll bus --json``."""
        return self.json

    def __repr__(self) -> str:
        segments = [segment for answer in self.answers for segment in answer.segments]
        loads = ", ".join(f"{each.name} {100 * each.utilisation:.1f} %" for each in segments)
        bounds = [bound for bound in self.table.column("bound_ms") if bound is not None]
        longest = f", longest bound {max(bounds):.3f} ms" if bounds else ""
        verdict = "every message is in time" if self.good else "a message is late or has no bound"
        return f"<{verdict}: {len(self.table)} messages, load at most {loads}{longest}>"


@checked
def bus(
    file: str | Path = BUILT_IN,
    *,
    dbc: str | Path | Sequence[str | Path] | None = None,
    map: str | Path | None = None,
    bitrate: int | None = None,
    data_bitrate: int | None = None,
    period_ms: float | None = None,
    simulate_s: float = 10.0,
    seed: int = 0,
    tick_ms: float = 10.0,
) -> BusAnalysis:
    """Compute response times and the delay of the loop, as ``canroll bus`` does.

    Args:
        file: built-in bus, network (.toml, .dbc, .kcd, .arxml, .sym), traffic set or log.
        dbc: own frames, one file or several.
        map: which of their signals the loop reads and sends.
        bitrate: bit/s; None: that of the file, of a log the one of its name.
        data_bitrate: of the data of FD frames, bit/s.
        period_ms: of the messages of a database that have no cycle time; None: left out.
        simulate_s: simulated time, s; 0: bounds alone.
        seed: of payloads and jitter.
        tick_ms: period of the loop, ms.

    Raises:
        CanrollError: an unknown bus, a file that cannot be read, an invalid number.
        VerdictError: a simulated response above its bound.
    """
    rates = {"bitrate": bitrate, "data_bitrate": data_bitrate}
    name = str(file)
    log = log_name(name)
    source: ExtendedLog | BusNetwork | TrafficSet
    if log is not None:
        own = load_profile(BUILT_IN, dbc, map)
        given = {key: value for key, value in rates.items() if value is not None}
        source = ExtendedLog(**{**log._asdict(), **given}, added=Added("canroll", own))
    elif dbc is not None or is_network(name):
        source = BusNetwork(Path(name).name, load_profile(name, dbc, map))
    else:
        path = Path(file)
        if not path.suffix and not path.exists():
            raise UnknownNameError("bus", name, BUSES)
        traffic = load_traffic(path, **rates, period_ms=period_ms)
        source = TrafficSet(path.name, traffic)
    options = AnalysisOptions(SENSOR, None, tick_ms, None, simulate_s, seed, False)
    answers = source.analyse(options, lambda *_: None)
    for answer in answers:
        answer.check()
    return BusAnalysis(tuple(answers), source.as_json(answers))
