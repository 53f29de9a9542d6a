"""What a node tells the process that started it: one JSON document a line, on a pipe of its own.

Standard output is no place for it: the DDS implementation prints its own errors there.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from typing import Any

from omni_ros.environment import REPORT_VARIABLE


def report(document: Mapping[str, Any]) -> None:
    """Write a document to the file descriptor that `REPORT_VARIABLE` names; nowhere without it.

    Args:
        document: what there is to tell, as strict JSON has it.
    """
    descriptor = os.environ.get(REPORT_VARIABLE)
    if descriptor is None:
        return
    line = json.dumps(document, allow_nan=False).encode() + b"\n"
    with contextlib.suppress(OSError):  # nobody listens any more
        os.write(int(descriptor), line)
