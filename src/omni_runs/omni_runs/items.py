"""Items of a workspace that commands accept by name: vehicles, experiments, studies, laws, ..."""

import re
from pathlib import Path

from omni_core.commands import commands_of, first_line
from omni_core.plugins import described_modules

KINDS = ("vehicles", "grounds", "sensors", "experiments", "tires")
STUDIES, LAWS = "studies", "laws"
EVERY = (*KINDS, STUDIES, LAWS)


def names_of(kind: str, workspace: Path) -> dict[str, str]:
    """Return the descriptions of the items of a kind (one of `EVERY`), keyed by name."""
    if kind == STUDIES:
        return commands_of("omni_studies.studies")
    if kind == LAWS:
        from omni_brake_assist.configuration import LAWS as BUILT_IN

        described = described_modules("omni_brake_assist.laws")
        return {name: first_line(described[name][1]) for name in BUILT_IN}
    files = sorted((workspace / "config" / kind).glob("*.yaml"))
    return {path.stem: first_sentence(path) for path in files}


def first_sentence(path: Path) -> str:
    """Return the first sentence of the comment at the head of a configuration file."""
    words: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        words.append(line.lstrip("# "))
        if line.rstrip().endswith((".", ":")):
            break
    text = " ".join(words)
    return re.split(r"(?<!Eq)(?<!Eqs)\. ", text)[0].rstrip(".:")
