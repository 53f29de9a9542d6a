"""Page with the status of each equation, figure, table and claim of the dissertation.

``python -m omni_studies.dissertation > docs/dissertation.md`` generates the page from
``docs/dissertation.yaml``.
"""

import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import yaml

from omni_core.commands.workspace import workspace_folder
from omni_studies.page_numbers import filled, stored

STATUSES = {
    "works": "implemented as in the text",
    "differs": "differs on purpose; the remark or the docstring of the module gives the reason",
    "partial": "partly implemented; the remark describes the part",
    "reference": "used only by tests",
    "missing": "not implemented",
    "background": "described in the text, but not used there",
}


class Row(NamedTuple):
    """One item of the dissertation, such as an equation, figure, table or claim.

    Attributes:
        place: equation, figure, table or section of the dissertation.
        what: content of the item.
        status: status in this project, a key of `STATUSES`.
        module: module that implements the item; may be empty.
        command: command that shows the item, tests as in ``test FILE FILE``, or first the command
            and then the tests; may be empty.
        remark: explanation of the status; may be empty.
        number: values of the dissertation and of this project, as text; may be empty.
    """

    place: str
    what: str
    status: str
    module: str
    command: str
    remark: str
    number: str = ""


def chapters(folder: Path) -> dict[str, list[Row]]:
    """Return the items in the workspace's ``docs/dissertation.yaml``, keyed by chapter."""
    text = (folder / "docs/dissertation.yaml").read_text(encoding="utf-8")
    document = yaml.safe_load(filled(text, "", stored(folder)))
    return {title: [Row(*map(str, row)) for row in rows] for title, rows in document.items()}


def page(folder: Path) -> str:
    """Return the page as Markdown, generated from the files of the workspace."""
    found = chapters(folder)
    counts = Counter(row.status for rows in found.values() for row in rows)
    parts = [
        "# The dissertation, row by row\n\nThis page lists every equation, figure, table and claim "
        "of the dissertation, its status in this project,\nand the command or test that shows it.\n"
        "\n"
        "This page is generated from `dissertation.yaml` by "
        "`python -m omni_studies.dissertation`; do not edit it.\n"
        '"The text" is V. Kálmán, *On modeling and control of omnidirectional '
        "wheels*, BME Budapest 2013.\n"
        "`./omni` runs what a row shows, a test by `./omni test FILE`.\n\n"
        "| status | rows | meaning |\n|---|---|---|",
        *(f"| {status} | {counts[status]} | {words} |" for status, words in STATUSES.items()),
    ]
    for title, rows in found.items():
        parts.append(
            f"\n## {title}\n\n| text | claim | status | shown by | module | number and remark |"
        )
        parts.append("|---|---|---|---|---|---|")
        for row in rows:
            study, _, tests = row.command.partition("test ")
            shown = " ".join(
                [*([f"`{study.strip()}`"] if study else []), *map(_link, tests.split())]
            )
            remark = "; ".join(filter(None, (row.number, row.remark)))
            parts.append(
                f"| {row.place} | {row.what} | {row.status} | {shown} | {_link(row.module)} | "
                f"{remark} |"
            )
    return "\n".join(parts) + "\n"


def _link(path: str) -> str:
    return f"[`{Path(path).name}`](../{path})" if path else ""


if __name__ == "__main__":
    sys.stdout.write(page(workspace_folder()))
