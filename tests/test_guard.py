"""Who may ask a page's server, and what its answers let a browser do."""

from __future__ import annotations

from pathlib import Path

import pytest
from starlette.testclient import TestClient

from mpvi_bt.apps.watch.edited_tree import Edited
from mpvi_bt.apps.watch.guard import PageGuard
from mpvi_bt.apps.watch.watched_run import WatchedRun
from mpvi_bt.apps.watch.watched_suite import WatchedSuite
from tests.test_watch import TREE, run_of

HERE = "http://127.0.0.1:80"
TYPED = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "https://127.0.0.1:80"},
        {"origin": "http://127.0.0.1:81"},
        {"host": "evil.example:80"},
        {"host": "127.0.0.1.evil.example"},
        {"host": "10.0.0.1:80"},
        {"host": ""},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
    ],
)
def test_other_sites_are_refused(headers: dict[str, str], method: str) -> None:
    """A page of another site, or of another port, cannot have its visitor's browser ask here, by whatever name."""
    client = TestClient(PageGuard(WatchedRun(Path("none")).app), base_url=HERE)
    given = {"host": "127.0.0.1:80", **headers}
    path = "/" if method == "GET" else "/control"
    refused = client.request(method, path, headers=given, content=b'{"pause": ""}')
    assert refused.status_code == 403
    assert "default-src 'none'" in refused.headers["content-security-policy"]
    for ours in ({}, {"origin": HERE}, {"sec-fetch-site": "same-origin"}, {"sec-fetch-site": "none"}):
        answer = client.request(method, path, headers={"host": "127.0.0.1:80", **ours}, content=b'{"pause": ""}')
        assert answer.status_code == (200 if method == "GET" else 409)  # 409: this run has no debugger


def test_a_link_that_is_followed_from_elsewhere_is_let_in() -> None:
    """As from a chat; but what it would change, by a form, is not."""
    client = TestClient(PageGuard(WatchedRun(Path("none")).app), base_url=HERE)
    assert client.get("/", headers=TYPED).status_code == 200
    assert client.post("/control", headers=TYPED, content=b"{}").status_code == 403


@pytest.mark.parametrize("host", ["localhost:9000", "LOCALHOST", "127.0.0.1:1", "127.8.9.1:80", "[::1]:5173"])
def test_this_machine_is_asked_at_any_port(host: str) -> None:
    """A port that `ssh -L` forwards is another one than the server listens at."""
    client = TestClient(PageGuard(WatchedRun(Path("none")).app), base_url=HERE)
    assert client.get("/", headers={"host": host, "origin": f"http://{host}"}).status_code == 200


def test_who_asks_by_another_name_is_told_what_came_and_what_to_do() -> None:
    """In one line."""
    client = TestClient(PageGuard(WatchedRun(Path("none")).app), base_url=HERE)
    told = client.get("/", headers={"host": "my-robot:80"}).text
    assert "'my-robot:80'" in told
    assert "--serve 0.0.0.0:PORT" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("path", ["//other.example/", "/\\other.example/", "///other.example"])
def test_the_token_is_taken_from_the_address_without_leaving_this_site(path: str) -> None:
    """A path that a browser would take for another site's name is none."""
    client = TestClient(PageGuard(WatchedRun(Path("none")).app, "secret"), base_url="http://robot:80")
    url = client.build_request("GET", "http://robot:80/").url.copy_with(raw_path=f"{path}?token=secret".encode())
    answer = client.get(url, headers={"accept": "text/html"}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"][:2]) == (303, "/o")
    open_ = TestClient(PageGuard(WatchedRun(Path("none")).app), base_url=HERE)
    assert open_.get("/?token=x", headers={"accept": "text/html"}, follow_redirects=False).status_code == 200


def test_every_answer_has_a_content_policy(tmp_path: Path) -> None:
    """Pages the one that they have inside, which runs no script but theirs; all else none; and there is an icon."""
    file = tmp_path / "tree.yaml"
    file.write_text(TREE, encoding="utf-8")
    trace = tmp_path / "a.trace.jsonl"
    trace.write_bytes(run_of(tmp_path).read_bytes())
    edited = Edited(file)
    for app in (WatchedRun(trace).app, WatchedRun(Path("none")).app, WatchedSuite(tmp_path).app, edited.app):
        client = TestClient(PageGuard(app), base_url=HERE)
        for path in ("/", "/nothing"):
            answer = client.get(path)
            policy = answer.headers["content-security-policy"]
            assert policy.startswith("default-src 'none'")
            assert "frame-ancestors" in policy
            assert "unsafe" not in policy
            if "<script>" in answer.text:
                assert "script-src 'sha256-" in policy
        icon = client.get("/favicon.ico")
        assert (icon.status_code, icon.headers["content-type"]) == (200, "image/svg+xml")
    edited.close()


@pytest.mark.parametrize("body", [b"[" * 9_000, b'{"pause": "\\ud800"}', b'{"a":' * 1_000, b"\xff"])
def test_no_body_breaks_the_server(body: bytes) -> None:
    """Nested deep, half of a surrogate pair, no text at all: each is refused as what it is."""
    client = TestClient(PageGuard(WatchedRun(Path("none"), lambda words: None, ["pause"]).app), base_url=HERE)
    assert client.post("/control", content=body).status_code == 400
