"""Users of one machine never share a folder for their files."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from omni_core.files import user_folder


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("home", ["/dev/null", "/proc/self/nothing"])
def test_without_a_usable_home_the_folder_is_private(home: str, temporary: Path) -> None:
    folder = user_folder("logs", Path(home) / ".ros" / "log")
    assert folder == temporary / f"logs_{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_what_another_user_has_made_is_not_used(
    kind: str, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The files of the tests then belong to another user.
    user = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: user)
    made = temporary / f"logs_{user}"
    if kind == "file":
        made.touch()
    elif kind == "folder":
        made.mkdir()
        made.chmod(0o777)
    else:
        made.symlink_to("/tmp")
    folder = user_folder("logs")
    assert folder != made
    assert folder.parent == temporary
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_the_first_usable_folder_is_used(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(temporary / "home"))
    assert user_folder("logs", "/dev/null/logs", "~/a/b", "~/c") == temporary / "home" / "a" / "b"
