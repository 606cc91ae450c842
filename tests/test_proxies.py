"""Proxies of the environment: never for this machine, told where they fail, and their passwords never."""

from __future__ import annotations

import socket
import time

import pytest

from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.openai import OpenAIModel
from mpvi_bt.executive.remote.connection import Connection
from mpvi_bt.ground import proxies
from mpvi_bt.ground.errors import ModelError, PolicyError, UserError
from tests.chat_servers import ChatServer, Reply, free_port

pytest.importorskip("openai")
ASK = [Message("user", "is the cup held")]
NAMES = ("http_proxy", "https_proxy", "all_proxy", "no_proxy", "ws_proxy", "wss_proxy")
OWN = socket.gethostname()


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever proxies this machine has are not those of the tests."""
    for name in (*NAMES, *map(str.upper, NAMES), "OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.9.9.9", "[::1]", "localhost", "x.localhost", OWN, OWN.upper(), f"{OWN}.", "0.0.0.0"]
)
def test_this_machine_needs_no_proxy(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By loopback addresses, as localhost, and by its own name."""
    monkeypatch.setenv("http_proxy", "http://proxy.example:3128")
    assert proxies.is_this_machine(f"http://{host}:8000/v1")
    assert proxies.proxy_for(f"http://{host}:8000/v1") == ""


@pytest.mark.parametrize("host", ["gpu.example", "10.255.255.1", f"{OWN}.no-such.invalid", f"not-{OWN}", "[fe80::1]"])
def test_other_machines_are_others(host: str) -> None:
    """One of the same first name is this one only where its name leads here."""
    assert not proxies.is_this_machine(f"http://{host}:8000/v1")


def test_the_environment_names_the_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the scheme, or for all; but for what no_proxy names."""
    url = "http://gpu.example:8000/v1"
    assert proxies.proxy_for(url) == ""
    monkeypatch.setenv("ALL_PROXY", "proxy.example:1")
    assert proxies.proxy_for(url) == "http://proxy.example:1"
    monkeypatch.setenv("http_proxy", "http://me:password@proxy.example:2")
    assert proxies.proxy_for(url) == "http://me:password@proxy.example:2"
    assert proxies.told(proxies.proxy_for(url)).endswith("http://proxy.example:2")
    monkeypatch.setenv("no_proxy", "gpu.example")
    assert proxies.proxy_for(url) == ""


@pytest.mark.parametrize("proxy", ["http://127.0.0.1:{port}", "socks5://127.0.0.1:{port}", "gopher://x"])
def test_a_server_of_this_machine_is_reached_past_proxies(
    scripted_chat_server: ChatServer, monkeypatch: pytest.MonkeyPatch, proxy: str
) -> None:
    """By its own name, too, and though the proxies are down or none."""
    for name in NAMES[:3]:
        monkeypatch.setenv(name, proxy.format(port=free_port()))
    for host in ("127.0.0.1", "localhost"):
        assert OpenAIModel("m", f"http://{host}:{scripted_chat_server.port}/v1", retries=0).ask(ASK).text == "yes"


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_a_proxy_that_is_down_is_told_as_one(monkeypatch: pytest.MonkeyPatch, scheme: str) -> None:
    """Not as a server that is not there; its password is not told."""
    port = free_port()
    monkeypatch.setenv(f"{scheme}_proxy", f"http://someone:password@127.0.0.1:{port}")
    with pytest.raises(ModelError) as failed:
        OpenAIModel("m", f"{scheme}://gpu.example:8000/v1", retries=0).ask(ASK)
    assert failed.value.reason == "endpoint_down"
    assert f"cannot be reached, through the proxy of the environment, http://127.0.0.1:{port}" in str(failed.value)
    assert "password" not in str(failed.value)


@pytest.mark.parametrize(("status", "reason"), [(407, "endpoint_down"), (502, "server_error"), (504, "server_error")])
def test_a_proxy_that_answers_itself_is_named(
    scripted_chat_server: ChatServer, monkeypatch: pytest.MonkeyPatch, status: int, reason: str
) -> None:
    """It may be its own trouble that it tells of."""
    scripted_chat_server.answers([Reply("<html>no", status)])
    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{scripted_chat_server.port}")
    with pytest.raises(ModelError) as failed:
        OpenAIModel("m", "http://gpu.example/v1", retries=0).ask(ASK)
    assert failed.value.reason == reason
    assert "the proxy of the environment, http://127.0.0.1" in str(failed.value)


@pytest.mark.parametrize("proxy", ["socks5://me:password@127.0.0.1:1", "gopher://me:password@x"])
def test_a_proxy_that_cannot_be_used_is_told(monkeypatch: pytest.MonkeyPatch, proxy: str) -> None:
    """In one line, before anything is asked."""
    monkeypatch.setenv("all_proxy", proxy)
    with pytest.raises(UserError, match="the proxy of the environment, ") as failed:
        OpenAIModel("m", "http://gpu.example/v1")
    assert "password" not in str(failed.value)


def test_a_policys_proxy_that_is_down_is_told_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a model's is."""
    port = free_port()
    monkeypatch.setenv("http_proxy", f"http://someone:password@127.0.0.1:{port}")
    with pytest.raises(PolicyError) as failed:
        Connection("ws://gpu.example:8000", time.monotonic() + 0.5, 1000)
    assert failed.value.reason == "server_absent"
    assert f"the proxy of the environment, http://127.0.0.1:{port}, is not there" in str(failed.value)
    assert "password" not in str(failed.value)
