"""Take the files of this folder from a tree of an earlier release.

    git worktree add --detach TREE a41be7f2
    python3 tests/earlier_release/extract.py TREE MADE

MADE contains files that the commands of that tree have written: ``my_robot``, the vehicle of
docs/tutorials/your_vehicle.md by ``./omni new-vehicle``, and in ``parameters`` the files of
``./omni ros-params`` for this vehicle (``--brakes on_off``) and for those of ``config/hardware``.
"""

import ast
import json
import re
import shlex
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
RENAMED = ("omni_platform", "omni_loop", "omni_figures")
PAGES = ("README.md", "docs/**/*.md", "src/*/README.md", "bags/README.md")
OF_DEVELOPERS = ("test", "exec bash", "exec mypy", "exec ruff", "exec colcon", "exec perf",
                 "exec python -m pip", "exec python -m omni_studies.page_numbers")  # fmt: skip
PLACEHOLDERS = {"COMMAND", "NAME", "DIR", "VEHICLE", "...", "BAG..."}


def names(tree: Path) -> str:
    """Return a line with the public names of each module of the renamed packages."""
    lines = []
    for package in RENAMED:
        for path in sorted((tree / "src" / package / package).rglob("*.py")):
            parts = path.relative_to(tree / "src" / package).with_suffix("").parts
            public = []
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef):
                    public.append(node.name)
                elif isinstance(node, ast.Assign | ast.AnnAssign):
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    public += [one.id for place in targets for one in ast.walk(place)
                               if isinstance(one, ast.Name)]  # fmt: skip
            module = ".".join(part for part in parts if part != "__init__")
            lines.append(" ".join([module, *(one for one in public if not one.startswith("_"))]))
    return "\n".join(lines) + "\n"


def commands(tree: Path) -> str:
    """Return the complete command lines of the pages, one a line, without ``./omni``."""
    found = set()
    for pattern in PAGES:
        for page in tree.glob(pattern):
            text = page.read_text(encoding="utf-8").replace("\\\n", " ")
            for line in re.findall(r"(?:^|`) *\./omni ([^`\n]*)", text, re.MULTILINE):
                words = shlex.split(re.split(r" [>|&] ?|&$", line)[0], comments=True)
                if words and not PLACEHOLDERS & set(words):
                    found.add(shlex.join(words))
    return "\n".join(sorted(one for one in found if not one.startswith(OF_DEVELOPERS))) + "\n"


def files(tree: Path, made: Path) -> dict[str, str]:
    """Return the content of all files of a user, keyed by path."""
    found = [(path, path.relative_to(tree)) for path in tree.glob("config/*/*.yaml")]
    found += [(path, path.relative_to(made)) for path in made.rglob("*.yaml")]
    found.append((tree / "docs/tutorials/own_law.ipynb", Path("own_law.ipynb")))
    texts = {str(name): path.read_text(encoding="utf-8") for path, name in sorted(found)}
    page = (tree / "docs/extending.md").read_text(encoding="utf-8")
    return texts | dict(re.findall(r"```python\n# (my_(?:law|odometry)\.py)\n(.*?)```", page, re.S))


def main() -> None:
    """Write all files."""
    tree, made = map(Path, sys.argv[1:])
    for name, content in (
        ("names.txt", names(tree)),
        ("commands.txt", commands(tree)),
        ("files.json", json.dumps(files(tree, made), indent=1) + "\n"),
    ):
        (HERE / name).write_text(content, encoding="utf-8")
    shutil.copytree(tree / "bags/small_stop/assisted", HERE / "recording", dirs_exist_ok=True)


if __name__ == "__main__":
    main()
