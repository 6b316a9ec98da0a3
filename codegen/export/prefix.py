"""The prefix of all that a bundle shows to the outside: symbols, macros, files, build targets.

Bundles of different prefixes go into one image, and into one build.
"""

import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from canroll.errors import CanrollError

DEFAULT = "canroll"
TAKEN = ("node", "session")
"""Prefixes of the functions of ``board/`` and ``test/``."""
BUILD = ("CMakeLists.txt", "Kconfig", "library.json", "module.yml", "prj.conf", "sample.yaml")
"""Files of build systems, in which the name alone is that of a target, option or package."""
USERS = "stage"
"""Folder with a source of the engineer's."""
_ALONE = r"(?<![A-Za-z0-9])(?<!exported by )(canroll|CANROLL)(?![A-Za-z0-9])"
_NAMES = re.compile(
    r"(?:(?<![A-Za-z0-9])|(?<=-D))(canroll|CANROLL)(?=_|\.h\b|\.a2l\b|::)"
    r"|(?<=::)(canroll)\b|(?<=find_package\()(canroll)\b|(?<=CONFIG_)(CANROLL)\b"
    r"|(?<=/begin PROJECT )(canroll)\b"
)
_BUILD_NAMES = re.compile(rf"{_NAMES.pattern}|{_ALONE}")


def checked(prefix: str) -> str:
    """Return a prefix that C takes.

    Raises:
        CanrollError: it is no C identifier, reserved, or the prefix of functions beside the loop.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix):
        raise CanrollError(
            f"--prefix {prefix}: must be a C identifier that does not begin with an underscore"
        )
    if prefix.lower() in TAKEN:
        raise CanrollError(f"--prefix {prefix}: is that of functions of the bundle's own: another")
    return prefix


def renamed(texts: Mapping[str, str], prefix: str) -> dict[str, str]:
    """Return the files of a bundle, by name, with another prefix in names and contents."""
    if prefix == DEFAULT:
        return dict(texts)

    def new(match: re.Match[str]) -> str:
        return prefix.upper() if match[0].isupper() else prefix

    def content(name: str, text: str) -> str:
        names = _BUILD_NAMES if PurePosixPath(name).name in BUILD else _NAMES
        return text if name.startswith(f"{USERS}/") else names.sub(new, text)

    return {
        name if name.startswith(f"{USERS}/") else _NAMES.sub(new, name): content(name, text)
        for name, text in texts.items()
    }
