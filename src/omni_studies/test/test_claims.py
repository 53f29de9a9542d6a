"""The results of claims depend on the metrics that they name."""

from __future__ import annotations

import math
import re
from importlib.resources import files

import numpy as np
import pytest
import yaml

import omni_studies
from omni_runs.metrics import Metric
from omni_studies.claims import evaluate

CLAIMS = yaml.safe_load((files(omni_studies) / "claims.yaml").read_text(encoding="utf-8"))


def metric_names(expression: str) -> set[str]:
    """Return the names of metrics that suffice to evaluate an expression."""
    names = set(re.findall(r"\b[a-z]\w*\.\w+", expression))
    patterns = re.findall(r'of\((\w+), "([^"]+)"\)', expression)
    names |= {f"{name}.{case.replace('*', own)}" for name, case in patterns for own in "ab"}
    words = set(re.findall(r"\b[a-z]\w+\b(?!\(|\.)", re.sub(r'"[^"]*"', "", expression)))
    quantities = {name.partition(".")[0] for name in names}
    return names | {f"{word}.{case}" for word in words - quantities for case in "ab"}


@pytest.mark.parametrize("study", CLAIMS)
def test_random_numbers_do_not_meet_a_claim_always(study: str) -> None:
    random = np.random.default_rng(1)
    expressions = " ".join(row["value"] for row in CLAIMS[study])
    names = sorted(metric_names(expressions))
    missed: set[str] = set()
    for _ in range(50):
        values = np.exp(random.normal(0.0, 2.0, len(names))).tolist()
        metrics = {name: Metric(v, "1") for name, v in zip(names, values, strict=True)}
        claims = evaluate(study, metrics)
        assert len(claims) == len(CLAIMS[study])
        missed |= {claim.sentence for claim in claims if claim.found.status == "missed"}
    assert missed == {row["claim"] for row in CLAIMS[study]}


@pytest.mark.parametrize("grounds", [("cork", "wood"), ("wood", "cork")])
def test_a_case_without_a_value_is_not_passed_over(grounds: tuple[str, str]) -> None:
    needed = {"cork": 0.5, "wood": math.nan}  # no overlap is enough on wood
    metrics = {f"overlap_needed.{ground}": Metric(needed[ground], "1") for ground in grounds}
    assert [claim.found.status for claim in evaluate("field_of_view", metrics)] == ["missed"]
