"""The documentation of parameters and commands agrees with the code."""

from __future__ import annotations

import ast
import json
import re
import runpy
from importlib.resources import files

import yaml
from omni_process import WORKSPACE, omni_here
from PIL import Image
from safety_table import TIMES, table
from safety_table import rows as hazards

import omni_studies
from omni_bringup.reference.parameters import reference
from omni_core.commands import commands_of
from omni_runs.metrics import run_metrics
from omni_runs.recorded_run import read_run
from omni_studies import page_numbers
from omni_studies.dissertation import STATUSES, chapters, page

GENERATED = {"dissertation.md", "options.md", "parameters.md"}
# Decimals that are settings, definitions, limits of studies or values of data sheets, by page
# or by the folder of its feature.
SETTINGS = {
    "allocation.md": "0.15 s, 0.3 deg",
    "drive": "0.3 s",
    "extending.md": "0.1 s",
    "glossary.md": "0.05 m/s",
    "identification": "0.01 s, 0.05 rad/s, 0.2 m, 0.3 m/s, 0.5 kg",
    "line_cameras.md": "0.4 times",
    "line_scan_sensor.md": "0.05 m/s, 0.3 m/s, 0.5 m/s, 0.7 m/s, 0.3 s, 0.25 px, 0.7 px, 25.6 mm",
    "metrics.md": "0.05 m/s, 0.3 s, 0.5 s, 1.5 px",
    "notes.md": "0.71 m",
    "performance.md": "0.2 s, 0.3 s, 0.5 ms, 1.5 times",
    "placement": "0.71 m, 1.6 m",
    "real_vehicle.md": "0.1 s",
    "robustness.md": "0.1 %, 0.4 m",
    "safety.md": "0.01 rad/s, 0.1 s, 0.12 s, 0.4 s, 0.5 m/s^2",
    "sensor_models.md": "0.14 deg",
    "stopping_area": "0.3 m/s, 0.5 m/s",
    "which_sensor.md": "0.74 m/s, 1.14 m/s, 2.5 m/s, 7.4 rad/s",
}


def test_parameter_reference_is_current() -> None:
    written = (WORKSPACE / "docs/parameters.md").read_text(encoding="utf-8")
    assert written == reference(), (
        "write it anew: python -m omni_bringup.reference.parameters > docs/parameters.md"
    )


def test_the_page_of_the_dissertation_is_current_and_names_what_exists() -> None:
    written = (WORKSPACE / "docs/dissertation.md").read_text(encoding="utf-8")
    assert written == page(WORKSPACE), (
        "write it anew: python -m omni_studies.dissertation > docs/dissertation.md"
    )
    for row in (row for rows in chapters(WORKSPACE).values() for row in rows):
        assert row.status in STATUSES, row
        assert (WORKSPACE / row.module).exists(), row
        command, _, tests = row.command.partition("test ")
        kind, _, name = command.strip().partition(" ")
        assert all((WORKSPACE / path).exists() for path in tests.split()), row
        assert {
            "study": name in commands_of("omni_studies.studies"),
            "exec": (WORKSPACE / name.removeprefix("python ")).exists(),
        }.get(kind, not kind), row
        if row.status in ("works", "differs"):
            assert row.command, row


def test_numbers_of_studies_are_filled() -> None:
    text = (WORKSPACE / "docs/dissertation.yaml").read_text("utf-8")
    for row in (row for rows in yaml.safe_load(text).values() for row in rows):
        if row[4].startswith("study ") and len(row) > 6:
            assert re.search(r"\{\w+:\w+\.", row[6]), row
    numbers = page_numbers.stored(WORKSPACE)
    for path, place in page_numbers.shown(WORKSPACE):
        assert place.metric in numbers[place.study], (path.name, place)


def test_each_template_is_of_one_table_of_a_page() -> None:
    patterns = ("README.md", "docs/*.md", "benchmarks/*.md", "src/**/README.md")
    pages = " ".join(
        page.read_text("utf-8") for pattern in patterns for page in WORKSPACE.glob(pattern)
    )
    files = sorted(path.stem for path in (WORKSPACE / "docs/templates").iterdir())
    assert sorted(re.findall(r"<!-- numbers: (\S+) -->", pages)) == files


def test_pictures_and_pages_show_the_same_numbers() -> None:
    numbers = page_numbers.stored(WORKSPACE)
    drawn = set()
    for picture in (WORKSPACE / "docs/images").glob("*.png"):
        with Image.open(picture) as image:
            found = json.loads(image.info.get(page_numbers.PICTURE_NUMBERS, "{}"))
        for path, place in page_numbers.shown(WORKSPACE):
            if place.study in found:
                old = format(found[place.study][place.metric], place.form)
                assert old == format(numbers[place.study][place.metric], place.form), (
                    f"{picture.name} is older than {path.name}: {place.metric}; "
                    "run benchmarks/pictures.py"
                )
        drawn |= {(study, picture.stem) for study in found}
    program = runpy.run_path(str(WORKSPACE / "benchmarks/pictures.py"))
    shown = {(study, name) for study, _, files in program["DRAWN"] for name in files}
    assert drawn == {one for one in shown if page_numbers.used_numbers(WORKSPACE, one[0])}


def test_measured_numbers_are_not_typed() -> None:
    """Decimals with a unit are in filled blocks, except settings, definitions and data sheets."""
    unit = r"(?:m/s\^2|m/s|rad/s|mm|ms|px|deg|kg|m|s|%|times)"
    found = {
        (page.parent.name if page.name == "README.md" else page.name, number)
        for pattern in ("README.md", "docs/**/*.md", "src/*/*/*/README.md")
        for page in WORKSPACE.glob(pattern)
        if page.name not in GENERATED
        for number in re.findall(rf"\d+\.\d+ {unit}(?!\w)", prose(page.read_text("utf-8")))
    }
    allowed = {
        (page, number) for page, numbers in SETTINGS.items() for number in numbers.split(", ")
    }
    assert found - allowed == set()


def prose(text: str) -> str:
    """Return a page without filled blocks, code, and lines that name a test for their numbers."""
    tested = re.sub(r"^.*`test_.*$", "", text, flags=re.MULTILINE)
    filled = r"<!-- numbers: .*?<!-- /numbers -->|```.*?```|`[^`\n]*`"
    return re.sub(filled, "", tested, flags=re.DOTALL)


def lines_of_pages() -> list[tuple[str, str]]:
    """Return the lines with their pages, without tables, blocks of code and templates."""
    exempt = re.compile(r"<!-- .*?-->|^ *```.*?^ *```|^[|!].*?$", re.DOTALL | re.MULTILINE)
    return [
        (page.name, line)
        for pattern in ("*.md", "docs/**/*.md", "src/**/README.md", "b*/README.md")
        for page in WORKSPACE.glob(pattern)
        if page.name not in GENERATED
        for line in exempt.sub("", page.read_text("utf-8")).splitlines()
    ]


def test_lines_of_pages_are_at_most_120_characters() -> None:
    assert not [(page, line) for page, line in lines_of_pages() if len(line) > 120]


def test_each_sentence_of_a_page_begins_on_a_new_line() -> None:
    """Headings, numbers of lists, and initials of names contain full stops too."""
    number = re.compile(r"^\W*\d+\. ")
    end = re.compile(r"[a-z0-9)\]`*][.?!] +[A-Z`\[*]")
    found = lines_of_pages()
    assert len(found) > 1000
    assert not [(page, line) for page, line in found if end.search(number.sub("", line))]


def test_every_metric_that_the_code_names_is_explained() -> None:
    explained = set(re.findall(r"`(\w+)`", (WORKSPACE / "docs/metrics.md").read_text("utf-8")))
    named = re.compile(r'f?"([a-z]\w*)\.[^"\n]*"\]? ?[:=]\s*(?:Metric|results_entry)\(')
    found = {
        name
        for folder in ("omni_runs", "omni_tools", "omni_studies", "omni_bringup")
        for module in (WORKSPACE / "src" / folder / folder).rglob("*.py")
        for name in named.findall(module.read_text("utf-8"))
    }
    assert len(found) > 80
    assert found <= explained
    run = read_run(WORKSPACE / "bags/small_stop/assisted")
    assert set(run_metrics(run)) <= explained | {f"brake_switchings.{w}" for w in run.wheel_names}
    assert set(commands_of("omni_studies.studies")) <= explained


def test_the_readme_of_a_package_names_its_modules() -> None:
    """The module of a node may have the name of the node instead."""
    for readme in WORKSPACE.glob("src/*/README.md"):
        package = readme.parent / readme.parent.name
        modules = {path.stem for path in package.glob("*.py")} - {"__init__"}
        modules |= {path.parent.name for path in package.glob("*/__init__.py")}
        words = " ".join(re.findall(r"`([^`\n]+)`", readme.read_text("utf-8")))
        named = set(re.findall(r"\w+", words))
        missing = {name for name in modules if not {name, name.removesuffix("_node")} & named}
        assert missing == set(), package.name


def test_claims_are_about_explained_metrics() -> None:
    explained = set(re.findall(r"`(\w+)`", (WORKSPACE / "docs/metrics.md").read_text("utf-8")))
    claims = yaml.safe_load((files(omni_studies) / "claims.yaml").read_text(encoding="utf-8"))
    expressions = " ".join(row["value"] for rows in claims.values() for row in rows)
    quantities = set(re.findall(r"\b([a-z]\w*)\.\w|of\((\w+), ", expressions))
    assert {name for found in quantities for name in found if name} <= explained


def test_docstrings_name_what_exists() -> None:
    """``module.name`` in a docstring begins with a name that the code has."""
    sources = sorted((WORKSPACE / "src").glob("*/*/**/*.py"))
    names = {part for path in sources for part in (*path.parts, path.stem)}
    docstrings = []
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names |= {
                name
                for field in ("id", "attr", "arg", "name", "module")
                for name in str(getattr(node, field, "")).split(".")
            }
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                docstrings.append((path, str(node.value.value)))
    dotted = re.compile(r"`([a-z_]\w*)\.[\w.]+`")
    unknown = {
        (str(path.relative_to(WORKSPACE)), name[0])
        for path, text in docstrings
        for name in dotted.finditer(text)
        if name[1] not in names
    }
    assert not unknown


def test_the_safety_case_has_the_marks_of_the_tests() -> None:
    page = (WORKSPACE / "docs/safety.md").read_text(encoding="utf-8")
    assert table() in page, "./omni exec python tests/safety_table.py"
    assert set(TIMES) <= {row.fault for row in hazards()}
    assert {row.hazard for row in hazards()} >= {
        "brakes released when they should act",
        "brakes held without pedal",
        "brakes act late",
        "a command of a second publisher acts",
    }


def test_help_names_every_option_of_the_readme() -> None:
    helped = omni_here(["run", "--help"])
    assert helped.returncode == 0
    for option in ("--variant", "--out", "--set", "--real-time", "--json", "EXPERIMENT"):
        assert option in helped.stdout
