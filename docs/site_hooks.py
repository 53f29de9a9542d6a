"""Links from the documentation to files of the workspace, for the site.

A page may link to a module, a configuration or the README of a package. The site brings what is
linked along below ``source/``, READMEs as pages and all else as text, so that it can be read
without the workspace.
"""

from __future__ import annotations

import json
import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

_ROOT = Path(__file__).resolve().parent.parent
_LINK = re.compile(r"\[([^\]\[]*)\]\(([^)\s#]+)((?:#[^)\s]*)?)\)")
_SOURCE = "source"
_PICTURES = (".png", ".svg", ".jpg")


def on_files(files: Files, config: Any) -> Files:
    """Add what the pages link to outside of ``docs/``, and what that links to."""
    for notebook in sorted((_ROOT / "docs").rglob("*.ipynb")):
        uri = notebook.relative_to(_ROOT / "docs").with_suffix(".md").as_posix()
        files.append(File.generated(config, uri, content=_as_page(notebook)))
    for place in _places(config["nav"]):
        files.append(_brought(_ROOT / place, config))
    waiting = [Path(file.abs_src_path) for file in files.documentation_pages() if file.abs_src_path]
    waiting += [_ROOT / place for place in _places(config["nav"])]
    seen: set[Path] = set(waiting)
    while waiting:
        page = waiting.pop()
        for _, link, _ in _LINK.findall(page.read_text(encoding="utf-8")):
            target = _target(page, link)
            if target is None or target in seen or _within_docs(target):
                continue
            seen.add(target)
            files.append(_brought(target, config))
            if target.suffix == ".md":
                waiting.append(target)
    return files


def _places(nav: Any) -> Iterator[str]:
    """Yield the files outside of ``docs/`` that the navigation names."""
    if isinstance(nav, str):
        if nav.startswith(f"{_SOURCE}/"):
            yield nav.removeprefix(f"{_SOURCE}/")
        return
    for part in nav.values() if isinstance(nav, dict) else nav:
        yield from _places(part)


def _as_page(notebook: Path) -> str:
    """Return the cells of a notebook as a page."""
    parts = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
    return "\n\n".join(parts) + "\n"


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Point the links of a page to where the site has what they mean."""
    del config, files
    uri = page.file.src_uri
    place = _ROOT / (uri.removeprefix(f"{_SOURCE}/") if uri.startswith(_SOURCE) else f"docs/{uri}")

    def pointed(match: re.Match[str]) -> str:
        words, link, anchor = match.groups()
        if ":" not in link and (place.parent / link).is_dir() and _target(place, link) is None:
            return words  # a folder, which a site has no page for
        target = _target(place, link)
        if target is None:
            return match.group(0)
        return f"[{words}]({posixpath.relpath(_uri(target), posixpath.dirname(uri))}{anchor})"

    return _LINK.sub(pointed, markdown)


def _target(page: Path, link: str) -> Path | None:
    """Return the file that a link means, None for one that is no file of the workspace."""
    if ":" in link or link.startswith("/"):
        return None
    target = Path(os.path.normpath(page.parent / link))
    if target.is_dir() and (target / "README.md").exists():
        target /= "README.md"
    return target if target.is_file() and target.is_relative_to(_ROOT) else None


def _within_docs(target: Path) -> bool:
    return target.is_relative_to(_ROOT / "docs") and target.suffix not in (".py", ".yaml")


def _uri(target: Path) -> str:
    if _within_docs(target):
        return target.relative_to(_ROOT / "docs").as_posix()
    plain = "" if target.suffix in (".md", *_PICTURES) else ".txt"
    return f"{_SOURCE}/{target.relative_to(_ROOT).as_posix()}{plain}"


def _brought(target: Path, config: Any) -> File:
    return File.generated(config, _uri(target), content=target.read_bytes())
