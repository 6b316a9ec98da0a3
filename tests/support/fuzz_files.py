"""A reader of files under atheris (libFuzzer): inputs guided by the coverage of what parses them.

    cd tests; python -m support.fuzz_files NAME GOOD [-runs=N] [-seed=S] [CORPUS]

NAME is a format of :mod:`support.hostile_formats`, GOOD a folder that its ``make`` has filled. An
input that is neither read nor refused in one line ends it, and is kept as ``crash-…``.
"""

import random
import shutil
import sys
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import atheris

# what holds kernels of numba is left out: instrumented, they do not compile
with atheris.instrument_imports(
    include=["canroll.documents", "cantools", "csv", "dbc", "json", "numpy.lib.format", "tomllib"],
):
    from support import hostile_formats as formats


def main(arguments: list[str]) -> None:
    """Fuzz one format; the process ends with it."""
    program, name, good, *options = arguments
    form = next(each for each in formats.FORMATS if each.name == name)
    atheris.instrument_func(form.read)
    content = (Path(good) / name).read_bytes()
    numbers = count()
    with TemporaryDirectory(prefix="canroll-fuzz-") as folder:

        def one(data: bytes) -> None:
            path = formats.placed(form, Path(good), Path(folder, str(next(numbers))), data)
            formats.refusal(form, path)
            shutil.rmtree(path.parent)

        def changed(data: bytes, most: int, seed: int) -> bytes:
            source = random.Random(seed)
            if source.randrange(2):
                return bytes(atheris.Mutate(data, most))
            return formats.damaged(data or content, source)[:most]

        corpus = Path(folder, "corpus")
        corpus.mkdir()
        (corpus / "good").write_bytes(content)
        limits = [f"-max_len={2 * len(content) + 4096}", "-rss_limit_mb=4096", "-timeout=60"]
        atheris.Setup([program, *limits, *options, str(corpus)], one, custom_mutator=changed)
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv)
