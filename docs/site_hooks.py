"""Links from the documentation to files of the workspace, for the site that starts with README.md.

A page may link to a module, a configuration or the README of a package. The site contains these
files below ``source/``, READMEs as pages and all others as text, so that it can be read without
the workspace. Besides the links that pages have, the first use of each term on a page links to the
glossary; a warning names the terms to which no page links. The tables of the programming interface
become docstrings.
"""

from __future__ import annotations

import json
import logging
import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from markdown.extensions.toc import slugify
from mkdocs.structure.files import File, Files

_ROOT = Path(__file__).resolve().parent.parent
_LINK = re.compile(r"\[([^\]\[]*)\]\(([^)\s#]+)((?:#[^)\s]*)?)\)")
_SOURCE = "source"
_PICTURES = (".png", ".svg", ".jpg")
_START, _GLOSSARY, _INTERFACE = "index.md", "glossary.md", "api.md"
_README = _ROOT / "README.md"  # the first page of the site
_ROW = re.compile(r"^\|(?: \[`([\w.]+)`\])?.*$", re.M)  # may name an object of Python
_LISTS = (_START, "options.md", "parameters.md", _INTERFACE, "dissertation.md")  # no prose
_linked_terms: set[str] = set()  # anchors of the terms to which a page links


def on_files(files: Files, config: Any) -> Files:
    """Add the files outside of ``docs/`` to which the pages link, and those to which these link."""
    for notebook in sorted((_ROOT / "docs").rglob("*.ipynb")):
        uri = notebook.relative_to(_ROOT / "docs").with_suffix(".md").as_posix()
        files.append(File.generated(config, uri, content=_as_page(notebook)))
    files.append(File.generated(config, _START, content=_README.read_bytes()))
    navigation = Path(config["config_file_path"]).read_text(encoding="utf-8")
    named = [_ROOT / place for place in re.findall(rf"{_SOURCE}/(\S+)", navigation)]
    for place in named:
        files.append(_brought(place, config))
    waiting = [Path(file.abs_src_path) for file in files.documentation_pages() if file.abs_src_path]
    waiting += [*named, _README]
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


def _as_page(notebook: Path) -> str:
    """Return the cells of a notebook as a page."""
    parts = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
    return "\n\n".join(parts) + "\n"


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Replace the links of a page by the addresses of the linked files on the site."""
    del config, files
    _linked_terms.update(re.findall(r"glossary\.md#([\w-]+)", markdown))
    uri = page.file.src_uri
    if uri == _INTERFACE:
        markdown = _ROW.sub(lambda row: f"::: {row[1]}\n" if row[1] else "", markdown)
    place = _ROOT / (uri.removeprefix(f"{_SOURCE}/") if uri.startswith(_SOURCE) else f"docs/{uri}")
    place = _README if uri == _START else place

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
    """Return the file to which a link refers; None if it is no file of the workspace."""
    if ":" in link or link.startswith("/"):
        return None
    target = Path(os.path.normpath(page.parent / link))
    if target.is_dir() and (target / "README.md").exists():
        target /= "README.md"
    return target if target.is_file() and target.is_relative_to(_ROOT) else None


def _within_docs(target: Path) -> bool:
    return target.is_relative_to(_ROOT / "docs") and target.suffix not in (".py", ".yaml")


def _uri(target: Path) -> str:
    if target == _README:
        return _START
    if _within_docs(target):
        return target.relative_to(_ROOT / "docs").as_posix()
    plain = "" if target.suffix in (".md", *_PICTURES) else ".txt"
    return f"{_SOURCE}/{target.relative_to(_ROOT).as_posix()}{plain}"


def _brought(target: Path, config: Any) -> File:
    return File.generated(config, _uri(target), content=target.read_bytes())


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Link the first use of each term of the glossary on a page to its definition."""
    del config, files
    uri = page.file.src_uri
    if uri in (_GLOSSARY, *_LISTS):
        return html
    place = posixpath.relpath(_GLOSSARY.replace(".md", ".html"), posixpath.dirname(uri))
    linked = set(re.findall(r"glossary\.html#([\w-]+)", html))
    waiting = {word: anchor for word, anchor in _terms() if anchor not in linked}
    parts = re.split(r"(<[^>]*>)", html)
    within = 0  # depth of elements that stay as they are
    for i, part in enumerate(parts):
        if part.startswith("<"):
            if found := re.match(r"<(/?)(a|code|pre|h\d|script|summary)\b", part):
                within += -1 if found[1] else 1
        elif not within:
            parts[i] = _linked(part, waiting, place)
    return "".join(parts)


def on_post_build(config: Any) -> None:
    """Warn of the terms of the glossary to which no page links."""
    del config
    if missing := sorted({anchor for _, anchor in _terms()} - _linked_terms):
        logging.getLogger("mkdocs.hooks").warning("no page links to: %s", ", ".join(missing))


def _terms() -> Iterator[tuple[str, str]]:
    """Yield the terms of the glossary in lower case, with the anchor of each."""
    text = (_ROOT / "docs" / _GLOSSARY).read_text(encoding="utf-8")
    for term in re.findall(r"^### (.+)$", text, re.M):
        for word in re.split(r", | \(|\)", term):
            if word:
                yield word.lower(), slugify(term, "-")


def _linked(text: str, waiting: dict[str, str], place: str) -> str:
    """Return text with links at the first uses of waiting terms, which are then removed."""
    if not waiting:
        return text
    # The longest first: "line pair" before "line".
    words = "|".join(re.escape(word) for word in sorted(waiting, key=len, reverse=True))

    def link(found: re.Match[str]) -> str:
        anchor = waiting.get(found[1].lower())
        if anchor is None:
            return found[0]
        for word in [word for word, other in waiting.items() if other == anchor]:
            del waiting[word]
        return f'<a href="{place}#{anchor}">{found[0]}</a>'

    return re.sub(rf"(?<![\w-])({words})s?(?![\w-])", link, text, flags=re.IGNORECASE)
