"""The scripted chat model says what it is told to."""

from __future__ import annotations

import pytest

from mpvi_bt.executive.language.chat import Answer, Message
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.ground.errors import ModelError

ASK = [Message("system", "Be brief."), Message("user", "Is it open?", b"png")]


def test_a_list_is_said_in_order() -> None:
    """Texts and whole answers come as they stand, errors are raised, and the end of the list is an error."""
    whole = Answer("no", "other", 2.5, 7, 1)
    model = ScriptedChatModel(["yes", whole, ModelError("refused", "no picture")], latency_s=1.5)
    first = model.ask(ASK, {"type": "object"})
    assert (first.text, first.model, first.latency_s, first.kept) == ("yes", "scripted", 1.5, False)
    assert model.ask(ASK) == whole
    for reason in ("refused", "not_recorded"):
        with pytest.raises(ModelError) as error:
            model.ask(ASK)
        assert error.value.reason == reason
    assert [schema for _, schema in model.asked] == [{"type": "object"}, None, None, None]


def test_a_function_answers_by_the_question() -> None:
    """It is handed the messages."""
    model = ScriptedChatModel(lambda messages: messages[-1].text.upper())
    assert model.ask(ASK).text == "IS IT OPEN?"
    assert model.asked[0][0] == tuple(ASK)
