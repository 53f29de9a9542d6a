"""Set the version of the newest entry of CHANGELOG.md in every file that must name it.

Run ``python3 setup/release.py`` after adding an entry. A test compares the files.
"""

import re
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent
_PLACES = (
    ("src/*/package.xml", r"(<version>).*(</version>)"),
    ("CITATION.cff", r"(?m)^(version: ).*()$"),
)


def version() -> str:
    """Return the version of the newest entry of CHANGELOG.md, such as ``0.1.0``."""
    text = (_ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return str(re.findall(r"(?m)^## \[?(\d+\.\d+\.\d+)", text)[0])


def outdated() -> "dict[Path, str]":
    """Return the corrected text of each file that names another version, keyed by path."""
    found = {}
    for pattern, place in _PLACES:
        for file in sorted(_ROOT.glob(pattern)):
            text = file.read_text(encoding="utf-8")
            changed = re.sub(place, rf"\g<1>{version()}\g<2>", text)
            if changed != text:
                found[file] = changed
    return found


if __name__ == "__main__":
    for file, text in outdated().items():
        file.write_text(text, encoding="utf-8")
        print(file)
