"""Error raised by readers of recordings."""

from pathlib import Path
from typing import Any

from omni_core.configuration import InputError


class BagError(InputError):
    """A recording cannot be used.

    Attributes:
        folder: path of the recording.
        problem: the defect of the recording.
    """

    def __init__(self, folder: Path, problem: str) -> None:
        super().__init__(f"{folder}: {problem}")
        self.folder = folder
        self.problem = problem

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the constructor and its arguments, so that workers can pickle the error."""
        return type(self), (self.folder, self.problem)


class McapError(ValueError):
    """A file is not an MCAP file, is damaged, or contains lengths that exceed the limits.

    Attributes:
        problem: the defect of the file.
        recoverable: whether other messages of the file can be recovered, because it is incomplete,
            for example since the recorder was killed, or because a single message is invalid.
    """

    def __init__(self, problem: str, *, recoverable: bool = False) -> None:
        super().__init__(problem)
        self.problem = problem
        self.recoverable = recoverable
