"""``canroll`` without its start: each command is forked from a process that has it imported.

A start imports for three seconds and loads the plant's machine code for one more, most of what a
short command takes. Inside :func:`served` the program ``canroll`` of a shell is a client of a few
lines: it hands its arguments, folder, environment and streams on and ends with the exit code.
"""

import contextlib
import io
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name

ROOT = Path(__file__).resolve().parents[1]
VARIABLE = "CANROLL_SERVED"
"""Names, for processes inside, the folder with the program."""
CLIENT = """\
#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({path!r})
    told = json.dumps([sys.argv, os.getcwd(), dict(os.environ)]).encode() + b"\\n"
    socket.send_fds(server, [told], [0, 1, 2])
    sys.exit(int(server.recv(8) or 1))
"""
WARM = ("run", "double_lane_change", "--duration", "0.1", "--out")
"""Loads what most commands need."""


@contextlib.contextmanager
def served() -> Iterator[Path]:
    """Serve commands while the body runs; yield the folder with the program ``canroll``."""
    if VARIABLE in os.environ:
        yield Path(os.environ[VARIABLE])
        return
    python = ROOT / ".venv" / "bin" / "python"
    with tempfile.TemporaryDirectory(prefix="canroll-warm-") as folder:
        path = f"{folder}/socket"
        program = Path(folder) / "canroll"
        program.write_text(CLIENT.format(python=python, path=path), encoding="utf-8")
        program.chmod(0o755)
        with socket.socket(socket.AF_UNIX) as listener:
            # whoever connects while the server imports waits
            listener.bind(path)
            listener.listen()
            number = listener.fileno()
            command = [str(python), "-m", "tools.warm", str(number)]
            server = subprocess.Popen(command, cwd=ROOT, pass_fds=[number])
        os.environ[VARIABLE] = folder
        try:
            yield Path(folder)
        finally:
            del os.environ[VARIABLE]
            server.terminate()
            server.wait()


def serve(number: int) -> int:
    """Fork for each command that comes to a socket; return, in its process, its exit code."""
    # here alone: whoever is served does not need what canroll needs
    main, commands = map(resolve_name, ("canroll.cli.main:main", "canroll.cli.commands"))

    with contextlib.redirect_stdout(io.StringIO()), tempfile.TemporaryDirectory() as folder:
        main([*WARM, folder])
    for name in commands.COMMANDS:
        resolve_name(commands.parser_of(name).handler)
    listener = socket.socket(fileno=number)
    while True:
        client, _ = listener.accept()
        if not os.fork():
            break
        client.close()
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
    listener.close()
    _receive(client)
    try:
        code: int = main()
    except SystemExit as ended:
        code = int(ended.code or 0)
    for text in (sys.stdout, sys.stderr):
        text.flush()
    client.sendall(str(code).encode())
    return code


def _receive(client: socket.socket) -> None:
    """Become the process that a client describes."""
    told, streams, _, _ = socket.recv_fds(client, 1 << 20, 3)
    while not told.endswith(b"\n"):
        told += client.recv(1 << 20)
    sys.argv, folder, environment = json.loads(told)
    for number, (stream, name) in enumerate(
        zip(streams, ("stdin", "stdout", "stderr"), strict=True)
    ):
        os.dup2(stream, number)
        os.close(stream)
        # whether it can seek is a property of the file that it was opened for
        buffering = 1 if name == "stderr" else -1
        mode = "w" if number else "r"
        setattr(sys, name, open(number, mode, buffering, "utf-8", closefd=False))  # noqa: SIM115
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)


if __name__ == "__main__":
    sys.exit(serve(int(sys.argv[1])))
