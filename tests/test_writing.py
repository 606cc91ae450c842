"""Files are written whole or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.writing import write_whole


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    """Nothing else is left in the folder."""
    for text in ("long " * 1000, "short"):
        write_whole(tmp_path / "a", text)
        assert (tmp_path / "a").read_text() == text
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


def test_what_fails_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk is a fault of the machine, and costs nothing that was written before."""
    write_whole(tmp_path / "a", "before")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mpvi_bt.ground.writing.os.fsync", full)
    with pytest.raises(BackendError, match="a: cannot be written: no space left on device"):
        write_whole(tmp_path / "a", "after")
    assert (tmp_path / "a").read_text() == "before"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_is_not_there_is_bad_input(tmp_path: Path) -> None:
    """The user named it."""
    with pytest.raises(UserError, match="cannot be written: no such file or directory"):
        write_whole(tmp_path / "none" / "a", "")


def test_permissions_are_those_of_the_umask_or_of_the_file(tmp_path: Path) -> None:
    """So that a shared folder's results can be read by others."""
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "new", "")
        (tmp_path / "old").touch()
        (tmp_path / "old").chmod(0o604)
        write_whole(tmp_path / "old", "")
    finally:
        os.umask(before)
    assert [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("new", "old")] == [0o640, 0o604]


def test_a_link_stays_one(tmp_path: Path) -> None:
    """What it points to is written."""
    (tmp_path / "to").touch()
    (tmp_path / "link").symlink_to("to")
    write_whole(tmp_path / "link", "x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "to").read_text() == "x"


def test_what_is_no_file_is_not_replaced() -> None:
    """A device stays one."""
    write_whole("/dev/null", "x")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(BackendError, match="no space left"):
        write_whole("/dev/full", "x")
