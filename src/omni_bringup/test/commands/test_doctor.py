"""``./omni doctor`` lists the folders that the workspace fills."""

from __future__ import annotations

from pathlib import Path

import pytest

from omni_bringup.commands.doctor import _folders


def test_folders_are_listed_with_the_size_of_their_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr("sys.prefix", str(tmp_path / "no environment"))
    textures, logs = tmp_path / "home" / "omni_sim" / "textures", tmp_path / "logs"
    monkeypatch.setenv("ROS_LOG_DIR", str(logs))
    for folder, megabytes in ((textures, 2), (tmp_path / "bags" / "run", 5), (logs, 3)):
        folder.mkdir(parents=True)
        (folder / "file").write_bytes(bytes(megabytes * 1_000_000))
    assert _folders(tmp_path) == f"{tmp_path / 'bags'} 5 MB, {textures} 2 MB, {logs} 3 MB"
