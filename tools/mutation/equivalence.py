"""Whether a mutant of the firmware can differ from it at all.

Trivial compiler equivalence (Papadakis 2015): the emitted C gives the same object code at -O2. As
the translation omits bounds that its intervals show to be unreachable, this also finds mutants that
differ only for values that cannot occur.
"""

import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from canroll.errors import CanrollError
from codegen.c99.emit import Emitter
from codegen.proof.prove import prove
from codegen.run import native
from codegen.subset.parse import load
from tools.mutation.mutants import write


class Original:
    """The unchanged firmware, with which mutants are compared."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self.texts = texts
        compiler = native.compiler()
        if compiler is None:
            raise CanrollError("no C compiler found: install one (cc)")
        self.compiler = compiler
        with self._folder() as temporary:
            self.files = Emitter(load(folder=Path(temporary))).files()

    def _folder(self, module: str = "", changed: str = "") -> tempfile.TemporaryDirectory[str]:
        folder = tempfile.TemporaryDirectory()
        write({**self.texts, **({module: changed} if module else {})}, Path(folder.name))
        return folder

    def examine(self, module: str, changed: str) -> tuple[str, str]:
        """Return the objection of the translation or its proof to a changed module, or "".

        Without an objection, also return why the firmware is equivalent, or "".
        """
        with self._folder(module, changed) as temporary:
            try:
                program = load(folder=Path(temporary))
                files = Emitter(program).files()
                proof = prove(program)
            except OSError:
                raise
            # whatever else it is, the tests of the translation fail of it
            except Exception as error:
                return f"{type(error).__name__}: {error}".replace(f"{temporary}/", ""), ""
        if proof.findings:
            return str(proof.findings[0]).removeprefix(f"{temporary}/"), ""
        same = self._objects(self.files, files) == self._objects(files, self.files)
        return "", "the same object code at -O2" if same else ""

    def _objects(self, files: Mapping[str, str], others: Mapping[str, str]) -> list[bytes]:
        """The object code of the ``files`` that differ from ``others``."""
        built = []
        with tempfile.TemporaryDirectory() as temporary:
            for name, text in files.items():
                (Path(temporary) / name).write_text(text, encoding="utf-8")
            headers = any(files[n] != others[n] for n in files if n.endswith(".h"))
            for name in sorted(files):
                if name.endswith(".c") and (headers or files[name] != others[name]):
                    command = [self.compiler, "-std=c99", "-O2", "-c", name, "-o", "object"]
                    subprocess.run(command, cwd=temporary, check=True, capture_output=True)
                    built.append((Path(temporary) / "object").read_bytes())
        return built
