"""Commands in forks of a process that has imported the package: true processes, without the time of a start."""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import json
import os
import pkgutil
import runpy
import signal
import socket
import subprocess
import sys
import tempfile
import traceback
from functools import cache
from pathlib import Path
from typing import NoReturn

START = "import sys; from tests.warm import serve; serve(int(sys.argv[1]))"
MPVI = ("-c", "from mpvi_bt.apps.cli import main; main()")
ROOT = Path(__file__).parent.parent
UNLOADED = ("mpvi_bt.house.maniskill", "mpvi_bt.apps.cli.__main__")  # the first loads torch: seconds, for few commands


@cache
def _parent() -> socket.socket:
    """The connection to the process that forks; it ends with this one."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        command = [sys.executable, "-c", START, str(theirs.fileno())]
        process = subprocess.Popen(command, cwd=ROOT, pass_fds=[theirs.fileno()])

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours


def python(
    *words: str, cwd: Path | None = None, env: dict[str, str] | None = None, stdin: str = "", timeout: float = 60
) -> subprocess.CompletedProcess[str]:
    """Run `python WORDS...` in a fork: "-c" and code, "-m" and a module, or a file; then its arguments.

    As `subprocess.run` with its output captured as text. What Python reads when it starts, such as PYTHONPATH, stays as
    it is in this process; the working folder is searched for modules first.
    """
    parent = _parent()
    with contextlib.ExitStack() as stack:
        files = [stack.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8", newline="")) for _ in range(3)]
        files[0].write(stdin)
        files[0].seek(0)
        asked = {"words": words, "cwd": str(cwd or Path.cwd()), "env": dict(os.environ) if env is None else env}
        socket.send_fds(parent, [json.dumps(asked).encode()], [file.fileno() for file in files])
        parent.settimeout(timeout)
        pid = int(parent.recv(64))
        try:
            status = int(parent.recv(64))
        except TimeoutError:
            os.kill(pid, signal.SIGKILL)
            parent.settimeout(None)
            parent.recv(64)
            raise subprocess.TimeoutExpired(words, timeout) from None
        for file in files:
            file.seek(0)
        out, err = (file.read().replace("\r\n", "\n") for file in files[1:])
        return subprocess.CompletedProcess(words, status, out, err)


def serve(descriptor: int) -> None:
    """Fork for each request until the other end closes."""
    import mpvi_bt

    for module in pkgutil.walk_packages(mpvi_bt.__path__, "mpvi_bt."):
        if not module.name.startswith(UNLOADED):
            importlib.import_module(module.name)
    gc.freeze()  # the forks share what is there already
    with socket.socket(fileno=descriptor) as asked:
        while True:
            request, files, _, _ = socket.recv_fds(asked, 1 << 20, 3)
            if not request:
                return
            pid = os.fork()
            if pid == 0:
                asked.close()
                _become(files, **json.loads(request))
            for file in files:
                os.close(file)
            asked.send(str(pid).encode())
            asked.send(str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())


def _become(files: list[int], words: list[str], cwd: str, env: dict[str, str]) -> NoReturn:
    """Run Python's words with these standard streams and end with their code."""
    code: object = 1
    try:
        _run(files, words, cwd, env)
        code = 0
    except SystemExit as end:
        code = end.code
        if isinstance(code, str):
            print(code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:  # not the end of Python itself: that visits each object of all modules, some 0.4 s
        atexit._run_exitfuncs()
        sys.stdout.flush()
        os._exit(code if isinstance(code, int) else int(code is not None))


def _run(files: list[int], words: list[str], cwd: str, env: dict[str, str]) -> None:
    for descriptor, file in enumerate(files):
        os.dup2(file, descriptor)
        os.close(file)
    sys.stdin, sys.stdout, sys.stderr = (
        os.fdopen(descriptor, mode, encoding="utf-8", closefd=False) for descriptor, mode in enumerate(("r", "w", "w"))
    )
    os.environ.clear()
    os.environ.update(env)
    os.chdir(cwd)
    match words:
        case ["-c", code, *rest]:
            sys.argv = ["-c", *rest]
            exec(compile(code, "<string>", "exec"), {"__name__": "__main__"})
        case ["-m", module, *rest]:
            sys.argv = [module, *rest]
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        case [path, *rest]:
            sys.argv, sys.path[0] = [path, *rest], str(Path(path).parent)
            runpy.run_path(path, run_name="__main__")
