"""Monitor of wheel loads above the range of the tire model.

Above the largest permissible load, the parabola of Eq. (3) has no physical meaning (dissertation,
section 2.3.1), so the dynamics use the force at this limit. This module reports such overloads to
the user.
"""

from collections.abc import Sequence

import numpy as np

from omni_platform.quantities import FloatArray


class Overload:
    """Monitors the wheel loads of a run.

    Attributes:
        time: total time of overload since the start, summed over the wheels [s].
    """

    def __init__(
        self, wheel_names: Sequence[str], model: str, limit: float, physics_step: float
    ) -> None:
        """Create a monitor that has recorded no overload.

        Args:
            wheel_names: wheel names in the order of all wheel arrays.
            model: name of the tire model.
            limit: largest load for which the model is valid [N].
            physics_step: length of a step [s].
        """
        self.time = 0.0
        self._names, self._model, self._limit = tuple(wheel_names), model, limit
        self._step = physics_step
        self._largest = np.zeros(len(self._names))

    def update(self, load: FloatArray, overloaded_steps: int) -> bool:
        """Update the monitor with a control period.

        Args:
            load: wheel loads at the end of the period [N], shape (N,).
            overloaded_steps: number of physics steps with overload since the start, summed over
                wheels.

        Returns:
            Whether a wheel was overloaded within the period.
        """
        self._largest = np.maximum(self._largest, load)
        before, self.time = self.time, overloaded_steps * self._step
        return self.time > before

    @property
    def largest_load(self) -> dict[str, float]:
        """Largest load of each overloaded wheel at the end of a control period [N]."""
        loads = zip(self._names, self._largest.tolist(), strict=True)
        return {name: load for name, load in loads if load > self._limit}

    def sentence(self) -> str:
        """Return a description of the overload."""
        wheels = ", ".join(f"{name} up to {load:.0f} N" for name, load in self.largest_load.items())
        return (
            f"overload: wheels carried more than the {self._limit:.0f} N that the tire model "
            f"{self._model} covers, for {self.time:.3g} s in total"
            f"{f' ({wheels})' if wheels else ''}; their forces were computed at "
            f"{self._limit:.0f} N"
        )
