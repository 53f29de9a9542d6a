"""The examples of the README run without changes and without ROS, and measure the given motion."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).resolve().parents[1] / "README.md"
WITHOUT_ROS = "import sys; sys.modules['rclpy'] = sys.modules['sensor_msgs'] = None\n"


EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text("utf-8"), re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES, ids=["lines", "flow"])
def test_an_example_measures_without_ros(example: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS + example], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    printed = re.findall(r"\[([^]]*)\] \[[^]]*\]", ran.stdout)
    assert len(printed) == 2
    twists = np.array([[float(word) for word in words.split()] for words in printed])
    np.testing.assert_allclose(twists, np.tile([1.2, 0.3, 0.2], (2, 1)), atol=0.02)
