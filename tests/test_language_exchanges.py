"""Exchanges on file: what was asked is not asked again, and a replay is exact."""

from __future__ import annotations

import hashlib
import json
import logging
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.executive.language.chat import Answer, Message
from mpvi_bt.executive.language.exchanges import KeptModel, check_folder
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.ground.errors import ModelError, UserError

PNG = b"\x89PNG some picture"
ASK = [Message("system", "Be brief."), Message("user", "Is the cup held?", PNG)]
SAID = Answer("yes", "tiny-1", 2.5, 700, 1, 3)


def kept(folder: Path, inner: ScriptedChatModel | None, model: str = "tiny") -> KeptModel:
    return KeptModel("openai:tiny", model, folder, inner)


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.json"))


def test_what_was_asked_is_not_asked_again(tmp_path: Path) -> None:
    """The answer on file is as it was, with its latency and tokens, but for being kept."""
    inner = ScriptedChatModel([SAID])
    assert kept(tmp_path, inner).ask(ASK) == SAID
    again = kept(tmp_path, inner).ask(ASK)
    offline = kept(tmp_path, None).ask(ASK)
    assert again == offline == replace(SAID, kept=True)
    assert len(inner.asked) == 1


def test_a_question_is_known_by_its_content(tmp_path: Path) -> None:
    """Model, roles, texts, pictures and schema all matter; the order of a schema's keys does not."""
    text, schema = ASK[1].text, {"type": "object", "required": ["held"]}
    questions: list[tuple[str, list[Message], Any]] = [
        ("tiny", ASK, None),
        ("other", ASK, None),
        ("tiny", ASK[1:], None),
        ("tiny", [Message("user", ASK[0].text), ASK[1]], None),
        ("tiny", [ASK[0], Message("user", text)], None),
        ("tiny", [ASK[0], Message("user", text, PNG + b"x")], None),
        ("tiny", [ASK[0], Message("user", text + " ", PNG)], None),
        ("tiny", [Message("system", "Be"), Message("user", "brief." + text, PNG)], None),
        ("tiny", ASK, {}),
        ("tiny", ASK, schema),
    ]
    inner = ScriptedChatModel(map(str, range(len(questions))))
    for _ in range(2):
        said = [kept(tmp_path, inner, model).ask(messages, schema).text for model, messages, schema in questions]
        assert said == [str(i) for i in range(len(questions))]
    assert kept(tmp_path, inner).ask(ASK, dict(reversed(schema.items()))).text == said[-1]
    assert len(files(tmp_path)) == len(questions)


def test_the_files_can_be_read_by_people(tmp_path: Path) -> None:
    """One JSON file an exchange, with the question in it; the picture lies beside it, once."""
    inner = ScriptedChatModel([SAID, "no"])
    kept(tmp_path, inner).ask(ASK, {"type": "object"})
    kept(tmp_path, inner).ask(ASK)
    digest = hashlib.sha256(PNG).hexdigest()
    assert [path.name for path in tmp_path.glob("*.png")] == [f"{digest}.png"]
    assert (tmp_path / f"{digest}.png").read_bytes() == PNG
    (data,) = (d for path in files(tmp_path) if (d := json.loads(path.read_text()))["schema"])
    assert data == {
        "exchange": 1,
        "model": "tiny",
        "messages": [
            {"role": "system", "text": "Be brief."},
            {"role": "user", "text": "Is the cup held?", "png": digest},
        ],
        "schema": {"type": "object"},
        "answer": {
            "text": "yes", "model": "tiny-1", "latency_s": 2.5, "tokens_in": 700, "tokens_out": 1, "tries": 3
        },
    }  # fmt: skip
    assert not list(tmp_path.glob(".*.tmp"))


def test_offline_what_is_not_on_file_is_an_error(tmp_path: Path) -> None:
    """It says which question, of which model, in which folder."""
    with pytest.raises(ModelError, match="never asked 'Is the cup held\\?' with picture") as error:
        kept(tmp_path, None).ask(ASK)
    assert error.value.reason == "not_recorded"
    assert str(tmp_path) in str(error.value)
    assert "openai:tiny" in str(error.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '{"exchange": 1}', "half", "\x00" * 40, '{"exchange": 2, "model": "m"}', None,
     '{"exchange": 1, "model": "m", "messages": [], "schema": null}'],
    ids=lambda text: str(text)[:40],
)  # fmt: skip
def test_a_broken_file_is_told_and_asked_anew(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, text: str | None
) -> None:
    """And mended; offline it is an error that names it."""
    kept(tmp_path, ScriptedChatModel(["old"])).ask(ASK)
    (path,) = files(tmp_path)
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2] if text is None else text)
    with pytest.raises(ModelError, match=path.name) as error:
        kept(tmp_path, None).ask(ASK)
    assert error.value.reason == "not_recorded"
    with caplog.at_level(logging.WARNING):
        assert kept(tmp_path, ScriptedChatModel(["new"])).ask(ASK).text == "new"
    assert [record.getMessage().count(path.name) for record in caplog.records] == [1]
    assert kept(tmp_path, None).ask(ASK).text == "new"


@pytest.mark.parametrize("reason", ["refused", "bad_answer"])
def test_a_refusal_is_kept_like_an_answer(tmp_path: Path, reason: str) -> None:
    """It would come again, and cost again; from the file it costs nothing."""
    inner = ScriptedChatModel([ModelError(reason, "it won't look", 1.5, 40), "yes"])
    with pytest.raises(ModelError) as first:
        kept(tmp_path, inner).ask(ASK)
    assert (first.value.latency_s, first.value.tokens) == (1.5, 40)
    for model in (kept(tmp_path, inner), kept(tmp_path, None)):
        with pytest.raises(ModelError, match="it won't look") as again:
            model.ask(ASK)
        assert (again.value.reason, again.value.latency_s, again.value.tokens) == (reason, 1.5, 0)
    assert len(inner.asked) == 1


@pytest.mark.parametrize("reason", ["endpoint_down", "model_timeout", "rate_limited", "server_error"])
def test_what_may_pass_is_asked_again_but_replayed_as_it_was(tmp_path: Path, reason: str) -> None:
    """The run that is replayed went on from it; an answer takes its place."""
    inner = ScriptedChatModel([ModelError(reason, "not now", 3.0), ModelError(reason, "nor now"), "yes"])
    for _ in range(2):
        with pytest.raises(ModelError):
            kept(tmp_path, inner).ask(ASK)
    with pytest.raises(ModelError, match="nor now"):
        kept(tmp_path, None).ask(ASK)
    assert kept(tmp_path, inner).ask(ASK).text == "yes"
    assert kept(tmp_path, None).ask(ASK).text == "yes"


@pytest.mark.parametrize("reason", ["no_key", "wrong_key", "unknown_model", "over_budget", "not_installed"])
def test_what_is_nobodys_answer_is_not_kept(tmp_path: Path, reason: str) -> None:
    """Settings are mended, and then the question is asked."""
    inner = ScriptedChatModel([ModelError(reason, "no"), "yes"])
    with pytest.raises(ModelError):
        kept(tmp_path, inner).ask(ASK)
    assert not files(tmp_path)
    assert kept(tmp_path, inner).ask(ASK).text == "yes"


def test_of_two_who_ask_at_once_both_get_what_was_kept_first(tmp_path: Path) -> None:
    """So that the run, too, goes as its replay."""
    second = ScriptedChatModel(lambda messages: "second")

    def first(messages: Sequence[Message]) -> str:
        assert kept(tmp_path, second).ask(messages).text == "second"
        return "first"

    assert kept(tmp_path, ScriptedChatModel(first)).ask(ASK) == kept(tmp_path, None).ask(ASK)
    assert kept(tmp_path, None).ask(ASK).text == "second"


def test_threads_agree(tmp_path: Path) -> None:
    """All are told one answer, whoever was first."""
    inner = ScriptedChatModel(map(str, range(100)))
    with ThreadPoolExecutor(8) as pool:
        answers = {a.text for a in pool.map(lambda _: kept(tmp_path, inner).ask(ASK), range(30))}
    assert answers == {kept(tmp_path, None).ask(ASK).text}


WORKER = """
import sys
from pathlib import Path
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.exchanges import KeptModel
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
inner = ScriptedChatModel(lambda messages: f"{sys.argv[2]} says {messages[0].text}" + "x" * 5000)
model = KeptModel("openai:tiny", "tiny", Path(sys.argv[1]), inner)
for i in range(25):
    print(model.ask([Message("user", str(i), b"png" * 2000)]).text)
"""


def test_processes_share_a_folder(tmp_path: Path) -> None:
    """Several at once write whole files, and are told the same."""
    command = [sys.executable, "-c", WORKER, str(tmp_path)]
    workers = [subprocess.Popen([*command, str(n)], stdout=subprocess.PIPE, text=True) for n in range(3)]
    said = [worker.communicate(timeout=120)[0].splitlines() for worker in workers]
    assert said[0] == said[1] == said[2]
    assert len(said[0]) == len(files(tmp_path)) == 25
    offline = kept(tmp_path, None)
    assert [offline.ask([Message("user", str(i), b"png" * 2000)]).text for i in range(25)] == said[0]


def test_texts_of_any_kind_are_kept(tmp_path: Path) -> None:
    """With halves of characters in the question, and any sign in the answer."""
    odd = "\ud83d \u2028 \x00 é 🙂"
    said = Answer('\u2028 \x00 é 🙂 \\ "', "m")
    assert kept(tmp_path, ScriptedChatModel([said])).ask([Message("user", odd)]).text == said.text
    assert kept(tmp_path, None).ask([Message("user", odd)]).text == said.text


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    """Before anything is asked, or at the first answer."""
    (file := tmp_path / "file").write_text("")
    check_folder(tmp_path / "new", offline=False)
    check_folder(tmp_path, offline=True)
    for folder, offline in ((tmp_path / "new", True), (file, False), (file, True)):
        with pytest.raises(UserError, match=str(folder)):
            check_folder(folder, offline)
    with pytest.raises(UserError, match="cannot be written"):
        kept(file / "in", ScriptedChatModel(["yes"])).ask(ASK)
