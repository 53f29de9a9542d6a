"""Options of a command line are read as declared, or rejected by their name."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from omni_core.commands.command_options import (
    CommandOptions,
    add_options,
    option,
    overrides_option,
    parse_options,
)
from omni_core.configuration import ConfigurationError, parameter


class Options(CommandOptions):
    """One option of each kind."""

    bag: Path = option(positional=True, metavar="BAG", description="recording")
    pairs: int = parameter(20, description="pairs of 100 %", minimum=1, maximum=64)
    peak_recovery: float = option(0.5, metavar="PX", unit="px", description="of a peak", above=0.0)
    metric: str = parameter("pearson", choices=("pearson", "cosine"), description="distance")
    ground: tuple[str, ...] = parameter(("cork", "stone"), description="ground")
    nodes: tuple[str, ...] = option((), many=True, description="nodes")
    overrides: tuple[str, ...] = overrides_option()
    pixels: int = option(0, unit="px", minimum=0, description="pixels")
    dpi: float | None = parameter(None, description="dots per inch", above=0.0)


def test_what_is_not_given_keeps_its_default() -> None:
    assert parse_options(Options, ["a"]) == Options(bag=Path("a"))


def test_every_kind_is_read() -> None:
    words = (
        "a --pairs 3 --peak-recovery 2 --metric cosine --ground wood --ground cork --dpi 1200 "
        "--nodes one two --set a=1 --set b=2 --json"
    )
    assert parse_options(Options, words.split()) == Options(
        bag=Path("a"),
        pairs=3,
        peak_recovery=2.0,
        metric="cosine",
        ground=("wood", "cork"),
        nodes=("one", "two"),
        overrides=("a=1", "b=2"),
        dpi=1200.0,
        json=True,
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--pairs 0", "^--pairs: 0 is out of range, must be at least 1 and at most 64$"),
        ("--peak-recovery nan", "^--peak-recovery: nan px is not a finite number"),
        ("--pairs many", "^--pairs: 'many' is a text, must be a whole number"),
        ("--peak-recovery 0,5", "'0,5' is .* a number in px, without its unit and with a decimal"),
        ("--pixels 9px", "^--pixels: '9px' is a text, .* whole number in px, without its unit$"),
        ("--dpi 0", "^--dpi: 0 is out of range"),
        ("--metric cosin", "^--metric: 'cosin' is not one of pearson, cosine; did you mean"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_option(words: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        parse_options(Options, ["a", *words.split()])


@pytest.mark.parametrize("words", [[""], ["a", "--pairs="], ["a", "--ground", "cork", "--ground="]])
def test_an_empty_text_is_no_folder_and_no_name(words: list[str]) -> None:
    with pytest.raises(ConfigurationError, match=r"^(BAG|--pairs|--ground): is empty"):
        parse_options(Options, words)


def test_an_empty_default_may_be_given() -> None:
    class Named(CommandOptions):
        namespace: str = option("", description="namespace")

    assert parse_options(Named, ["--namespace", ""]) == Named()


@pytest.mark.parametrize("words", [[], ["a", "--par", "1"]])
def test_what_is_no_option_is_refused(words: list[str]) -> None:
    with pytest.raises(SystemExit):
        parse_options(Options, words)


def test_help_says_unit_default_choices_and_repetition() -> None:
    parser = argparse.ArgumentParser()
    add_options(parser, Options)
    words = " ".join(parser.format_help().split())
    assert "--pairs N pairs of 100 % (default: 20)" in words
    assert "--peak-recovery PX of a peak [px] (default: 0.5)" in words
    assert "--metric {pearson,cosine}" in words
    assert "ground (may be repeated; default: cork, stone)" in words
    assert words.endswith("--dpi X dots per inch")
    assert "--set KEY=VALUE" in words
