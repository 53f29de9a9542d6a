"""Tables are read as written or refused with the line; users never share a folder for files."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from omni_core.files import read_columns, read_text, replaced, user_folder


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


def test_a_file_is_replaced_as_a_whole_or_not_at_all(temporary: Path) -> None:
    path = temporary / "file"
    with replaced(path) as new:
        new.write_text("old")
        assert not path.exists()
    with pytest.raises(UnicodeEncodeError), replaced(path) as new:
        new.write_text("\udcff", encoding="utf-8")
    assert path.read_text() == "old"
    assert list(temporary.iterdir()) == [path]


def test_two_writers_of_a_file_do_not_mix_their_contents(temporary: Path) -> None:
    path = temporary / "file"
    with replaced(path) as new:
        new.write_text("first")
        with replaced(path) as other:
            other.write_text("second")
        assert path.read_text() == "second"
        assert new.read_text() == "first"
    assert path.read_text() == "first"


UNITS = {"slip": "1", "load": "N", "force": "N"}


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        ("is empty", ""),
        ("is empty", "# only a comment\n\n"),
        ("no column 'load'", "slip,force\n0.1,100\n"),
        ("no column 'slip' and no column 'force'", "a,load,b\n1,2,3\n"),
        ("line 3: the force 'nan' is not finite", "slip,load,force\n0.1,3000,1\n0.1,3000,nan\n"),
        ("line 2: the slip 'inf' is not finite", "slip,load,force\ninf,3000,1\n"),
        ("line 4: there is no force", "# c\nslip,load,force\n0.1,3000,1\n0.1,3000,\n"),
        ("line 2: there is no load", "slip,load,force\n0.1\n"),
        ("line 2: the load 'x' is not a number", "slip,load,force\n0.1,x,1\n"),
        ("no column 'slip'.*separated by commas, and names: slip;load", "slip;load;force\n"),
        ("line 2: there are 5 values.* a decimal point", "slip,load,force\n0,1,3000,5,1\n"),
        ("line 3: the slip", 'slip,load,force\n0.1,3000,1\n"0.1,3000,1\n0.1,3000,1\n'),
        ("line 3: the load 0 N must be above 0", "slip,load,force\n0.1,1,1\n0.1,0,1\n"),
        ("is not a CSV file", f'slip,load,force\n"{"1" * 200_000}",1,1\n'),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_the_reason(
    reason: str, text: str, tmp_path: Path
) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=reason):
        read_columns(path, UNITS, {"load"})


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_a_table_in_another_encoding_is_refused_with_the_remedy(
    encoding: str, tmp_path: Path
) -> None:
    path = tmp_path / "data.csv"
    path.write_text("# größe\nslip,load,force\n0,1,2\n", encoding=encoding)
    with pytest.raises(ValueError, match=r"not text in UTF-8 .*: save it in this encoding"):
        read_columns(path, UNITS)


def test_a_text_of_a_stated_encoding_is_read(tmp_path: Path) -> None:
    path = tmp_path / "text"
    path.write_text("größe", encoding="latin-1")
    assert read_text(path, encoding="latin-1") == "größe"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_table_of_any_spreadsheet_is_read(end: str, tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    lines = ("# rig 3", "Force_N, speed , SLIP,load,", "900,20, 0.02,3000,", "", '-9,2,-0.5,"25",')
    path.write_text("\ufeff" + end.join(lines), encoding="utf-8", newline="")
    assert read_columns(path, UNITS) == [[0.02, 3000.0, 900.0], [-0.5, 25.0, -9.0]]
