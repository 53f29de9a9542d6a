"""Packages that only some commands need are installed when one of them imports them."""

from pathlib import Path

import pytest

from omni_core.plugins import import_optional

_LAUNCHER = """
import pathlib, sys
here = pathlib.Path(__file__).parent
print(*sys.argv[1:])
if sys.argv[2] != "refused":
    (here / "modules" / "brought.py").write_text("VALUE = 3")
sys.exit(sys.argv[2] == "refused")
"""


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("OMNI_WORKSPACE", str(tmp_path))
    (tmp_path / "modules").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path / "modules"))
    return tmp_path


def test_a_missing_group_is_installed_by_the_launcher(
    workspace: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (workspace / "omni").write_text(_LAUNCHER)
    assert import_optional("brought", "group").VALUE == 3
    assert capfd.readouterr() == ("", "install group\n")
    (workspace / "omni").unlink()
    assert import_optional("brought", "group").VALUE == 3


def test_without_a_launcher_or_with_its_refusal_the_module_is_missing(workspace: Path) -> None:
    with pytest.raises(ModuleNotFoundError, match="not_brought"):
        import_optional("not_brought", "group")
    (workspace / "omni").write_text(_LAUNCHER)
    with pytest.raises(ModuleNotFoundError, match="not_brought"):
        import_optional("not_brought", "refused")
