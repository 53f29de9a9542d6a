"""Draw the simulated results of ``docs/images`` again, and insert their numbers into the pages.

Run ``./omni exec python benchmarks/pictures.py [PICTURE...]`` with the names of pictures. Without a
name it draws all of them in about 4 minutes on two cores; ``limit_front`` needs CasADi. A picture
stores those of its numbers that the pages show, so a test detects a picture that is older than the
pages. ``which_sensor.png`` is drawn by ``benchmarks/which_sensor``; ``drive.png`` and
``report.png`` are screenshots.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from omni_studies.page_numbers import PICTURE_NUMBERS, used_numbers

_ROOT = Path(__file__).resolve().parents[1]

# Study name in docs/numbers.json, command, and file of each picture in the folder of the command.
DRAWN: tuple[tuple[str, tuple[str, ...], dict[str, str]], ...] = (
    (
        "run_straight_line",
        ("run", "straight_line"),
        {"straight_line_top_view": "top_view", "straight_line_time_series": "time_series"},
    ),
    (
        "swerve",
        ("study", "swerve"),
        {"forces": "forces", "manifold": "manifold", "weighting": "weighting"},
    ),
    ("wheels", ("study", "wheels"), {"wheel_kinds": "kinds"}),
    ("grounds", ("study", "grounds"), {"grounds": "grounds"}),
    ("tuning", ("study", "tuning"), {"tuning": "trade_off"}),
    (
        "placement_six",
        ("design-sensors", "--vehicle", "six_wheel_mecanum", "--confirm"),
        {"sensor_placement": "placements"},
    ),
    ("limit", ("limit", "straight_line", "--best"), {"limit_front": "front"}),
)
_LINES = "lines_show"
_SLOW_STOP = ("--variant", "unassisted", "--set", "maneuver.speed=1")


def omni(*words: str) -> dict[str, Any]:
    """Run a command of the workspace and return its JSON document."""
    command = [str(_ROOT / "omni"), *words, "--json"]
    found = subprocess.run(command, check=True, stdout=subprocess.PIPE)
    document: dict[str, Any] = json.loads(found.stdout)
    return document


def copy(picture: Path, target: Path, numbers: dict[str, dict[str, Any]]) -> None:
    """Copy a picture and store numbers in it, keyed by study and metric."""
    note = PngInfo()
    if numbers:
        note.add_text(PICTURE_NUMBERS, json.dumps(numbers, sort_keys=True))
    with Image.open(picture) as image:
        image.save(target, pnginfo=note, dpi=image.info["dpi"], optimize=True)


def main() -> None:
    """Draw the pictures that are named on the command line."""
    known = [name for *_, files in DRAWN for name in files] + [_LINES]
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="PICTURE", help=", ".join(known))
    names = parser.parse_args().names or known
    if unknown := set(names) - set(known):
        parser.error(f"unknown pictures: {', '.join(sorted(unknown))}")
    images = _ROOT / "docs/images"
    summaries = []
    with tempfile.TemporaryDirectory() as scratch:
        for study, words, files in DRAWN:
            if not set(names) & set(files):
                continue
            folder = Path(scratch) / study
            document = omni(*words, "--out", str(folder))
            values = {name: metric["value"] for name, metric in document["metrics"].items()}
            used = used_numbers(_ROOT, study)
            numbers = {study: {name: values[name] for name in sorted(used)}} if used else {}
            for name, file in files.items():
                copy(folder / f"{file}.png", images / f"{name}.png", numbers)
            if used:
                summary = folder.with_suffix(".json")
                summary.write_text(json.dumps(document), encoding="utf-8")
                summaries.append(f"{study}={summary}")
        if _LINES in names:
            drive = Path(scratch) / "drive"
            slow = (*_SLOW_STOP, "--set", "maneuver.direction_deg=45")
            omni("run", "straight_line", *slow, "--out", str(drive))
            target = str(images / f"{_LINES}.png")
            omni("lines", "show", str(drive / "unassisted"), "--duration", "0.1", "--out", target)
        if summaries:
            program = [sys.executable, "-m", "omni_studies.page_numbers", *summaries]
            subprocess.run(program, cwd=_ROOT, check=True)


if __name__ == "__main__":
    main()
