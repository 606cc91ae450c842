"""`mpvi doctor` finds what is missing, and never crashes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mpvi_bt.apps.cli import doctor
from tests.conftest import Shell


def named(checks: list[doctor.Check], name: str) -> doctor.Check:
    """The check of a name."""
    return next(check for check in checks if check.name == name)


def test_a_machine_that_works_is_healthy(mpvi: Shell) -> None:
    """Where the tests run, episodes can run: exit code 0, every core check ok, in JSON and in words."""
    done = mpvi("doctor", "--json")
    report = json.loads(done.stdout)
    assert (done.returncode, report["ok"]) == (0, True), done.stdout
    assert all(check["ok"] for check in report["checks"] if check["core"])
    words = mpvi("doctor")
    assert words.returncode == 0
    assert "Episodes can run here." in words.stdout


@pytest.mark.parametrize(
    "broken", ["raise ImportError('libX11.so.6: cannot open shared object file')", "import os; os.abort()"]
)
def test_a_library_that_breaks_is_a_finding(broken: str, tmp_path: Path, mpvi: Shell) -> None:
    """A simulator that does not load, or that ends its process, is reported with what mends it; exit code 3."""
    (tmp_path / "sapien.py").write_text(broken)
    done = mpvi("doctor", "--json", PYTHONPATH=str(tmp_path))
    report = json.loads(done.stdout)
    physics = next(check for check in report["checks"] if check["name"] == "physics")
    assert (done.returncode, report["ok"], physics["ok"], done.stderr) == (3, False, False, "")
    assert physics["mend"]


def test_a_hung_driver_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """A probe that does not answer is given up."""

    def hang(*args: object, **kwargs: object) -> None:
        raise subprocess.TimeoutExpired("probe", 1)

    monkeypatch.setattr(subprocess, "run", hang)
    checks = doctor.examine()
    assert not named(checks, "rendering").ok
    assert "no answer" in named(checks, "rendering").found


def test_a_missing_task_folder_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's folder that is not there is said, not raised."""
    monkeypatch.setenv("MPVI_PATH", "/nowhere")
    data = named(doctor.examine(), "data")
    assert not data.ok
    assert "/nowhere" in data.found


def test_keys_are_never_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether a key is set is said; the key is not."""
    monkeypatch.setenv("OPENAI_API_KEY", "secret-of-the-user")
    checks = doctor.examine()
    assert named(checks, "key").ok
    assert "secret" not in repr(checks)


@pytest.mark.render
def test_pictures_can_be_drawn_here() -> None:
    """Where rendering works, the probe draws what it should."""
    command = [sys.executable, "-m", "mpvi_bt.house.sim.probe", "picture"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "picture" in done.stdout


def test_the_endpoint_of_language_models_is_told_by_its_host(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the password that its address may have; one that is none is a finding."""
    for url, ok, found in (
        ("", True, "not set"),
        ("https://me:CANARY99@gateway.example:8443/v1", True, "gateway.example"),
        ("me:CANARY99@gateway.example", False, "must be like"),
    ):
        monkeypatch.setenv("OPENAI_BASE_URL", url)
        check = doctor._guarded("endpoint", False, "mend", doctor.endpoint)
        assert (check.ok, found in check.found) == (ok, True)
        assert "CANARY" not in check.found


def test_a_wrong_mpvi_path_is_mended_by_mending_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not by installing anything again."""
    monkeypatch.setenv("MPVI_PATH", "/nowhere")
    (data,) = [check for check in doctor.examine() if check.name == "data"]
    assert (data.ok, data.mend) == (False, "unset MPVI_PATH, or mend it")
