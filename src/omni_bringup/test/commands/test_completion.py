"""Completions of ./omni in bash."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from omni_bringup.cli import main

OFFER = (
    'COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _omni; echo "${{COMPREPLY[*]}}"'
)


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes_commands_options_and_names(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["completion"])
    assert ended.value.code == 0
    script = capsys.readouterr().out

    def offered(words: str) -> list[str]:
        asked = subprocess.run(
            ["bash", "-c", script + OFFER.format(words=words)],
            capture_output=True,
            text=True,
            check=True,
        )
        return asked.stdout.split()

    assert offered("./omni re") == ["replay", "report"]
    assert offered("./omni run small") == ["small_stop"]
    assert offered("./omni run --re") == ["--real-time", "--replace"]
    assert offered("./omni study table") == ["table2"]
    assert "--max-rotation" in offered("./omni study tuning --max")
    assert "mecanum_forklift" in offered("./omni drive --vehicle m")
    assert offered("./omni bag exp") == ["export"]
