"""Self-contained HTML file of a report.

The content security policy of the file forbids all requests and all scripts except its own, which
is identified by its hash. The content of recordings is a block of JSON, from which no text can
escape. The script inserts it as text, never as markup.
"""

import base64
import hashlib
import json
import string
from collections.abc import Mapping, Sequence
from importlib import resources

from omni_tools.report.document import report_document
from omni_tools.report.recording import ReportedRun

# in the order in which the browser reads them
_SCRIPTS = ("data.js", "top_view.js", "plots.js", "tables.js", "player.js")


def report_page(
    title: str, runs: Sequence[ReportedRun], seen: Mapping[str, bytes] | None = None
) -> str:
    """Return the HTML text of a report.

    Args:
        title: title of the report.
        runs: runs in the order in which they are listed; at least one.
        seen: figures (PNG) of the camera lines, by caption.

    Raises:
        ValueError: there is no run.
    """
    if not runs:
        raise ValueError("a report needs at least one run")
    style = _part("report.css")
    script = '"use strict";\n' + "".join(_part(name) for name in _SCRIPTS)
    pictures = {words: base64.b64encode(png).decode("ascii") for words, png in (seen or {}).items()}
    document = report_document(title, runs) | {"seen": pictures}
    data = json.dumps(document, allow_nan=False, separators=(",", ":"))
    parts = {
        "POLICY": (
            "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; "
            f"style-src '{_hash(style)}'; script-src '{_hash(script)}'"
        ),
        "STYLE": style,
        "SCRIPT": script,
        # A browser ends the block at "</script", even inside a JSON text.
        "DATA": data.replace("<", "\\u003c"),
    }
    return string.Template(_part("report.html")).substitute(parts)


def _part(name: str) -> str:
    return (resources.files(__package__) / "page" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"
