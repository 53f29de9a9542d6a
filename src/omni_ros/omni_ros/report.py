"""Reports of a node to the process that started it: one JSON document per line.

Standard output is not used because the DDS implementation prints its errors there.
"""

import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_ros.environment import REPORT_FILE_VARIABLE, REPORT_VARIABLE


def report(document: Mapping[str, Any]) -> None:
    """Write a document to the file descriptor and the file that environment variables name.

    Args:
        document: values that strict JSON can represent.
    """
    descriptor = os.environ.get(REPORT_VARIABLE)
    file = os.environ.get(REPORT_FILE_VARIABLE)
    line = json.dumps(document, allow_nan=False).encode() + b"\n"
    with contextlib.suppress(OSError):  # the reading process has ended
        if descriptor is not None:
            os.write(int(descriptor), line)
        if file is not None:
            with Path(file).open("ab") as reports:
                reports.write(line)
