"""A user's network as a file: segments, gateways, nodes, and the frames that carry our signals.

See docs/file-formats.md, "A network". Paths in it are relative to it. A traffic set or a database
is a network of one segment with its messages as background.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeAlias

from canroll import documents
from canroll.dbc.reader import Files, each, paths_of
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.plant_sim import buses
from canroll.plant_sim.buses.profile import BusProfile, accept
from canroll.plant_sim.buses.topology import (
    NODES,
    BusGateway,
    BusSegment,
    TimeSpread,
    Topology,
    check_times,
)
from canroll.plant_sim.can_bus.traffic.files import DATABASES, load_traffic
from canroll.plant_sim.kernels.instants import MS

_Kind: TypeAlias = type | tuple[type, ...]
_OF_A_SEGMENT: Final = {
    "bitrate": int,
    "data_bitrate": int,
    "load": float,
    "above": float,
    "bit_error_rate": float,
    "traffic": str,
}
_OF_A_FILE: Final[dict[str, _Kind]] = {"schema": int, "dbc": (str, list), "map": str, "node": dict}
KEYS: Final = {
    **_OF_A_FILE,
    **_OF_A_SEGMENT,
    "gateway_ms": object,
    "segment": dict,
    "gateway": list,
}
_OF_A_GATEWAY: Final = {"name": str, "segments": list, "latency_ms": object, "messages": list}
_OF_A_NODE: Final = {"segment": str, "jitter_ms": object}

_NAMES: Final[dict[_Kind, str]] = {
    (str, list): "a text or a list of texts",
    int: "a whole number",
    float: "a number",
    str: "a text",
    list: "a list",
    dict: "a table",
    object: "a time",
}
_DEFAULT_LOAD: Final = 0.5


def load_profile(
    name: str,
    dbc: str | Path | Sequence[str | Path] | None = None,
    map_file: str | Path | None = None,
) -> BusProfile:
    """Return the bus profile ``name``, or the network in the file of that name.

    Args:
        name: of a profile or of a file: see :data:`canroll.plant_sim.buses.BUSES`.
        dbc: frames that carry our signals, in a file or several, instead of the profile's own.
        map_file: says which signal of ``dbc`` is which field.

    Raises:
        UnknownNameError: there is no such profile.
        CanrollError: an extension's profile or a file that cannot be used.
    """
    profile = buses.load_profile(name)
    if dbc is None or map_file is None:
        return profile
    files = paths_of(dbc)
    for path in (*each(files), Path(map_file)):
        if not path.is_file():
            raise CanrollError(f"{path}: no such file")
    return replace(profile, dbc=files, map_file=Path(map_file))


def read_traffic(name: str) -> BusProfile:
    """Return the network with the periodic messages of a database or traffic set, ``file#bus``.

    Raises:
        CanrollError: the file cannot be read, or has several buses and none is chosen.
    """
    traffic = load_traffic(Path(name))
    profile = BusProfile(
        name=name,
        bitrate=traffic.bitrate,
        load=_DEFAULT_LOAD,
        data_bitrate=traffic.data_bitrate,
        traffic=Path(name),
    )
    return accept(name, profile)


def is_network(name: str) -> bool:
    """Return whether ``name`` is that of a bus, or of a TOML file with a network."""
    path = Path(name)
    suffix = Path(name.partition("#")[0]).suffix.lower()
    if suffix != ".toml":
        return name in buses.BUSES and suffix not in DATABASES
    try:
        return "schema" in documents.toml(path)
    except (OSError, ValueError):
        return False


def read_profile(name: str) -> BusProfile:
    """Return the network that the TOML file ``name`` describes.

    Raises:
        CanrollError: the file cannot be read, or a key has an invalid value.
    """
    path = Path(name)
    try:
        table = documents.toml(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: not a readable network: {reason(error)}") from error
    if "message" in table:
        return read_traffic(name)
    _check_keys(str(path), table, KEYS, required=("schema",))
    if table["schema"] != 1:
        raise CanrollError(f"{path}: schema must be 1, not {table['schema']}")
    if ("dbc" in table) != ("map" in table):
        raise CanrollError(f"{path}: dbc and map require each other")
    topology = _several(table, path) if "segment" in table else _one(table, path)
    topology = replace(topology, jitter=_jitter(table, path))
    home = topology.segments[topology.place("RollControl")]
    profile = BusProfile(
        name=path.stem,
        bitrate=home.bitrate,
        load=home.load,
        above=home.above,
        data_bitrate=home.data_bitrate,
        bit_error_rate=home.bit_error_rate,
        dbc=_descriptions(path, table),
        map_file=_beside(path, table, "map"),
        traffic=home.traffic,
        topology=topology,
    )
    return accept(str(path), profile)


def _check_keys(
    where: str,
    table: Mapping[str, Any],
    kinds: Mapping[str, _Kind],
    *,
    required: Sequence[str] = (),
) -> None:
    documents.refuse_unknown(table, kinds, f"key in {where}")
    for key in required:
        if key not in table:
            raise CanrollError(f"{where}: '{key}' is missing")
    for key, value in table.items():
        wanted = (int, float) if kinds[key] is float else kinds[key]
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise CanrollError(f"{where}: {key} = {value!r}: must be {_NAMES[kinds[key]]}")


def _one(table: Mapping[str, Any], path: Path) -> Topology:
    """The network of a file without segments: one, or two where it has a gateway."""
    if "gateway" in table:
        raise CanrollError(f"{path}: gateways join segments: describe them as [segment.NAME]")
    for name, node in table.get("node", {}).items():
        if isinstance(node, dict) and "segment" in node:
            raise CanrollError(f"{path} [node.{name}]: there is no [segment.{node['segment']}]")
    if "traffic" in table and "gateway_ms" in table:
        raise CanrollError(
            f"{path}: traffic says what is on the one segment: omit gateway_ms, or describe "
            "segments and gateways"
        )
    given = {key: table[key] for key in _OF_A_SEGMENT if key in table}
    plain = _segment(path, str(path), "bus", given)
    if "gateway_ms" not in table:
        return Topology((plain,))
    latency = _spread(table["gateway_ms"], path, f"{path}: gateway_ms", at_least=None)
    two = BusProfile(path.stem, plain.bitrate, plain.load, gateway_ms=(0.0, 0.0)).network
    segments = tuple(replace(plain, name=segment.name) for segment in two.segments)
    return replace(two, segments=segments, gateways=(replace(two.gateways[0], latency=latency),))


def _several(table: Mapping[str, Any], path: Path) -> Topology:
    """The network of a file with segments."""
    for key in (*_OF_A_SEGMENT, "gateway_ms"):
        if key in table:
            raise CanrollError(f"{path}: {key} is that of one bus: put it into a [segment.NAME]")
    names = list(table["segment"])
    if not names:
        raise CanrollError(f"{path}: [segment] is empty: a network has a [segment.NAME]")
    segments = tuple(
        _segment(path, f"{path} [segment.{name}]", name, entry)
        for name, entry in table["segment"].items()
    )
    gateways = tuple(
        _gateway(path, number, entry, names)
        for number, entry in enumerate(table.get("gateway", []), 1)
    )
    if len({gateway.name for gateway in gateways}) < len(gateways):
        raise CanrollError(f"{path}: two gateways have one name")
    places = {}
    for name, node in table.get("node", {}).items():
        if isinstance(node, dict) and "segment" in node:
            places[name] = _number(f"{path} [node.{name}]", names, node["segment"])
    return Topology(segments, gateways, places)


def _segment(path: Path, where: str, name: str, table: object) -> BusSegment:
    if not isinstance(table, dict):
        raise CanrollError(f"{where}: a segment is a table [segment.NAME]")
    _check_keys(where, table, _OF_A_SEGMENT, required=("bitrate",))
    if "traffic" in table and ("load" in table or "above" in table):
        raise CanrollError(f"{where}: traffic says what is on the segment: omit load and above")
    return BusSegment(
        name=name,
        bitrate=table["bitrate"],
        load=float(table.get("load", _DEFAULT_LOAD)),
        above=float(table.get("above", 0.5)),
        data_bitrate=table.get("data_bitrate", 0),
        bit_error_rate=float(table.get("bit_error_rate", 0.0)),
        traffic=_beside(path, table, "traffic"),
    )


def _gateway(path: Path, number: int, table: object, names: Sequence[str]) -> BusGateway:
    where = f"{path} gateway {number}"
    if not isinstance(table, dict):
        raise CanrollError(f"{where}: gateways are tables [[gateway]]")
    _check_keys(where, table, _OF_A_GATEWAY, required=("segments", "latency_ms"))
    joined = [_number(where, names, name) for name in table["segments"]]
    if len(set(joined)) != 2 or len(joined) != 2:
        raise CanrollError(f"{where}: segments = {table['segments']}: must be two of them")
    messages = table.get("messages")
    for entry in messages or ():
        if not isinstance(entry, str | int) or isinstance(entry, bool):
            raise CanrollError(f"{where}: messages: {entry!r} is neither name nor identifier")
    return BusGateway(
        name=str(table.get("name", f"gateway{number}")),
        segments=(joined[0], joined[1]),
        latency=_spread(table["latency_ms"], path, f"{where}: latency_ms", at_least=None),
        messages=None if messages is None else tuple(messages),
    )


def _number(where: str, names: Sequence[str], name: object) -> int:
    if name not in names:
        raise UnknownNameError(f"segment in {where}", str(name), names)
    return names.index(str(name))


def _jitter(table: Mapping[str, Any], path: Path) -> dict[str, TimeSpread]:
    jitter = {}
    for name, node in table.get("node", {}).items():
        where = f"{path} [node.{name}]"
        if name not in NODES:
            raise UnknownNameError(f"node in {path}", name, NODES)
        if not isinstance(node, dict):
            raise CanrollError(f"{where}: a node is a table [node.NAME]")
        _check_keys(where, node, _OF_A_NODE)
        if "jitter_ms" in node:
            jitter[name] = _spread(node["jitter_ms"], path, f"{where}: jitter_ms", at_least=0.0)
    return jitter


def _spread(given: object, path: Path, where: str, *, at_least: float | None) -> TimeSpread:
    """A time in ms: a number, least and greatest, or a file of measured ones.

    ``at_least``: where a single number is the greatest, the least; None: it is exact.
    """
    if isinstance(given, str):
        return TimeSpread.of_samples(_samples(path.parent / given, where))
    times = [given] if not isinstance(given, list) else given
    exact = [float(t) for t in times if isinstance(t, int | float) and not isinstance(t, bool)]
    if len(exact) != len(times) or len(times) != (2 if isinstance(given, list) else 1):
        raise CanrollError(
            f"{where} = {given!r}: must be a time, two times such as [5, 10], or the name of a "
            "file of measured times"
        )
    low = exact[0] if len(exact) == 2 or at_least is None else at_least
    check_times(where, low, exact[-1])
    return TimeSpread(round(low * MS), round(exact[-1] * MS))


def _samples(path: Path, where: str) -> tuple[int, ...]:
    """The measured times in a file, ns: the first column of it in ms, whatever its first line."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CanrollError(f"{where}: cannot read {path}: {reason(error)}") from error
    samples: list[int] = []
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].replace(";", ",").partition(",")[0].strip()
        try:
            time = float(text)
        except ValueError as error:
            if not text or (number == 1 and not samples):
                continue
            raise CanrollError(f"{path}:{number}: {text!r} is not a time in ms") from error
        check_times(f"{path}:{number}", time, time)
        samples.append(round(time * MS))
    if not samples:
        raise CanrollError(f"{path}: contains no time")
    return tuple(samples)


def _descriptions(path: Path, table: Mapping[str, Any]) -> Files | None:
    """The file or files with the frames that carry our signals."""
    given = table.get("dbc")
    if not isinstance(given, list):
        return _beside(path, table, "dbc")
    if not given or not all(isinstance(name, str) for name in given):
        raise CanrollError(f"{path}: dbc = {given!r}: must be {_NAMES[str, list]}")
    return paths_of([_there(path, "dbc", name) for name in given])


def _beside(path: Path, table: Mapping[str, Any], key: str) -> Path | None:
    return _there(path, key, str(table[key])) if key in table else None


def _there(path: Path, key: str, text: str) -> Path:
    name, mark, part = text.partition("#")
    file = path.parent / name
    if not file.is_file():
        raise CanrollError(f"{path}: {key} = '{text}': no such file")
    return Path(f"{file}{mark}{part}")
