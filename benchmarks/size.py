"""Measure the size of the project: lines of code and named numbers by package, words of the pages.

A line of code is a line that is not blank and not only a comment or docstring. A named number is a
number with a capitalized name at the top of a module, as in ``_LIMIT = 0.3``. All other numbers
in code, such as defaults, tables and numbers in functions, count as inline numbers unless they are
0, 1 or 2. Other lines are those of JavaScript, HTML, CSS, YAML, shell and the templates of pages.
Tests do not count.
A page is a Markdown file in Git other than the change log; generated pages count too. A word is
what stands between blanks, as for ``wc -w``; the bars of a table, code and comments count as well.
"""

import argparse
import ast
import io
import json
import subprocess
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]
OTHERS = (".js", ".html", ".css", ".yaml", ".yml", ".bash", ".sh", ".txt")
PARTS = ("src", "setup", "benchmarks", "docs", ".ci", "conftest.py", "omni")
NO_CODE = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE),
    *(tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER),
}


def sources() -> Iterator[tuple[str, Path]]:
    """Yield the files of code, each with the name of its package or folder."""
    for part in PARTS:
        place = WORKSPACE / part
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            parts = path.relative_to(WORKSPACE).parts
            if "test" not in parts and not path.is_symlink():
                yield (parts[1] if part == "src" else part), path


def code_lines(text: str) -> int:
    """Return the number of lines of code of a module."""
    strings: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        value = node.value if isinstance(node, ast.Expr) else None
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            strings |= set(range(value.lineno, (value.end_lineno or value.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - strings)


def constants(text: str) -> int:
    """Count the named numbers of a module."""
    found = 0
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            target, value = node.target, node.value
        else:
            continue
        pairs = [(target, value)]
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(target.elts, value.elts, strict=False))
        found += sum(
            name.id.lstrip("_")[:1].isupper() and is_number(number)
            for name, number in pairs
            if isinstance(name, ast.Name)
        )
    return found


def inline_numbers(text: str) -> int:
    """Count the numbers of a module other than 0, 1 and 2 that are not named numbers."""
    values = (node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant))
    found = sum(type(value) in (int, float) and value not in (0, 1, 2) for value in values)
    return found - constants(text)


def others() -> Iterator[tuple[str, int]]:
    """Yield the number of lines of each file with other code, with its package or folder."""
    listed = subprocess.run(
        ("git", "ls-files", *PARTS), cwd=WORKSPACE, check=True, stdout=subprocess.PIPE
    )
    for path in map(Path, listed.stdout.decode().splitlines()):
        if path.suffix in OTHERS and "test" not in path.parts:
            lines = (WORKSPACE / path).read_text(encoding="utf-8").splitlines()
            package = path.parts[1] if path.parts[0] == "src" else path.parts[0]
            yield package, sum(bool(line.strip()) for line in lines)


def is_number(node: ast.expr) -> bool:
    """Return whether an expression consists of numbers only."""
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def words() -> int:
    """Count the words of all pages."""
    listed = subprocess.run(
        ("git", "ls-files", "*.md"), cwd=WORKSPACE, check=True, stdout=subprocess.PIPE
    )
    pages = set(listed.stdout.decode().split()) - {"CHANGELOG.md"}
    return sum(len((WORKSPACE / page).read_text(encoding="utf-8").split()) for page in pages)


def main() -> None:
    """Count lines and named numbers, and print a table or a JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    as_json = parser.parse_args().json
    counts: dict[str, Counter[str]] = {
        name: Counter()
        for name in ("code_lines", "constants", "inline_numbers", "other_lines", "files")
    }
    for package, path in sources():
        text = path.read_text(encoding="utf-8")
        for name, number in (
            ("code_lines", code_lines(text)),
            ("constants", constants(text)),
            ("inline_numbers", inline_numbers(text)),
            ("files", 1),
        ):
            counts[name][package] += number
            counts[name]["all"] += number
    for package, number in others():
        counts["other_lines"][package] += number
        counts["other_lines"]["all"] += number
    if as_json:
        metrics = {
            f"{name}.{package}": {"value": number, "unit": "1"}
            for name, numbers in counts.items()
            for package, number in numbers.items()
        }
        metrics["words.pages"] = {"value": words(), "unit": "1"}
        print(json.dumps({"name": "size", "metrics": metrics}, indent=2))
        return
    print(f"{'':20}" + "".join(f"{name.replace('_', ' '):>16}" for name in counts))
    for package in sorted(counts["files"], key=lambda name: (name == "all", name)):
        print(f"{package:20}" + "".join(f"{n[package]:16}" for n in counts.values()))
    print(f"{'words of pages':20}{words():16}")


if __name__ == "__main__":
    main()
