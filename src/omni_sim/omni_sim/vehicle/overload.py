"""Monitor of wheels whose load exceeds the range of their tire model.

Above the largest permissible load the parabola (3) has no physical meaning (section 2.3.1), so
the dynamics use the force at that load. This module reports such overloads to the user.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from omni_platform.quantities import FloatArray


@dataclasses.dataclass(frozen=True)
class Overload:
    """Overload since the start of a run.

    Attributes:
        model: name of the tire model.
        limit: largest load that the model covers [N].
        largest_load: largest load of each overloaded wheel at the end of a control period [N].
        time: total time of overload, summed over the wheels [s].
    """

    model: str
    limit: float
    largest_load: Mapping[str, float]
    time: float

    def sentence(self) -> str:
        """Return a description of the overload."""
        wheels = ", ".join(f"{name} up to {load:.0f} N" for name, load in self.largest_load.items())
        return (
            f"overload: wheels carried more than the {self.limit:.0f} N that the tire model "
            f"{self.model} covers, for {self.time:.3g} s in sum"
            f"{f' ({wheels})' if wheels else ''}; their forces were computed at {self.limit:.0f} N"
        )


class OverloadWatch:
    """Monitors the wheel loads of a run.

    Attributes:
        overload: overload so far, None if there was none.
    """

    def __init__(
        self, wheel_names: Sequence[str], model: str, limit: float, physics_step: float
    ) -> None:
        """Start without overload.

        Args:
            wheel_names: wheel names in the order of all wheel arrays.
            model: name of the tire model.
            limit: largest load that the model covers [N].
            physics_step: length of a step [s].
        """
        self.overload: Overload | None = None
        self._names = tuple(wheel_names)
        self._model = model
        self._limit = limit
        self._step = physics_step
        self._largest = np.zeros(len(self._names))
        self._count = 0

    def update(self, load: FloatArray, overloaded_steps: int) -> bool:
        """Update with a control period.

        Args:
            load: wheel loads at the end of the period [N], shape (N,).
            overloaded_steps: physics steps with overload since the start, added up over wheels.

        Returns:
            Whether a wheel was overloaded within the period.
        """
        self._largest = np.maximum(self._largest, load)
        happened = overloaded_steps > self._count
        self._count = overloaded_steps
        if happened:
            self.overload = Overload(
                self._model,
                self._limit,
                {
                    name: float(largest)
                    for name, largest in zip(self._names, self._largest, strict=True)
                    if largest > self._limit
                },
                overloaded_steps * self._step,
            )
        return happened
