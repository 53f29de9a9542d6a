"""Folder of the recordings of `omni run` without the option --out."""

from pathlib import Path

from omni_bringup.commands import run
from omni_bringup.workspace import Workspace


def test_recordings_are_results_and_do_not_mix_with_those_of_the_repository(tmp_path: Path) -> None:
    folder = run._result_folder(run.Options(experiment="small_stop"), Workspace(tmp_path))
    assert folder.parent == tmp_path / "results" / "run" / "small_stop"
    assert not (tmp_path / "bags").exists()
