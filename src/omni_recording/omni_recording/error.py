"""Error raised by readers of recordings."""

from pathlib import Path

from omni_platform.configuration import InputError


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
