"""The vehicle on individual-roller wheels: exchangeable for `vehicle.Vehicle`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_platform.configuration import ConfigurationError
from omni_sim import dynamics, roller_dynamics
from omni_sim.friction import FrictionMap
from omni_sim.plant import static_loads
from omni_sim.roller_geometry import RollerGeometry
from omni_sim.roller_wheel import RollerConfiguration
from omni_sim.tmeasy import curve_coefficients
from omni_sim.vehicle import Vehicle
from omni_sim.vehicle_configuration import VehicleConfiguration

FloatArray = NDArray[np.float64]

DEFAULT_ROLLER_STEP = 0.0001
"""Physics step of a vehicle on individual rollers [s]: a tenth of a change of rollers at 10 m/s."""


class RollerVehicle(Vehicle):
    """A vehicle whose wheels have free rollers; everything else is that of `Vehicle`.

    In logs and properties a wheel's force is the part of all its rollers' forces along the
    nominal active direction; its slip and whether it slides are those of its lower roller; its
    limit is the sum of the rollers' limits.

    Attributes:
        rollers: what the rollers are like.
    """

    def __init__(
        self,
        configuration: VehicleConfiguration,
        rollers: RollerConfiguration | None = None,
        friction: FrictionMap | None = None,
        physics_step: float = DEFAULT_ROLLER_STEP,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        twist: ArrayLike = (0.0, 0.0, 0.0),
        wheel_angle: ArrayLike = 0.0,
    ) -> None:
        """Build the vehicle and place it, rolling.

        Args:
            configuration: what the vehicle is made of.
            rollers: of every wheel.
            friction: of the ground; by default ``mu/mu_0 = 1`` everywhere.
            physics_step: [s].
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: of base_link in the body frame [m/s, m/s, rad/s].
            wheel_angle: at the start, 0 with a roller's middle on the ground [rad], a number or
                shape (N,).

        Raises:
            ConfigurationError: the rollers do not fit on a wheel.
        """
        self.rollers = rollers or RollerConfiguration()
        n = len(configuration.wheels)
        self._start_angle = np.broadcast_to(np.asarray(wheel_angle, dtype=np.float64), (n,)).copy()
        self._rollers = np.zeros((n, self.rollers.count, roller_dynamics.ROLLER_SIZE))
        self._wrench = np.zeros(3)
        self.geometries = _geometries(configuration, self.rollers)
        super().__init__(configuration, friction, physics_step, pose, twist)
        self._more = self._build()

    def _build(self) -> roller_dynamics.RollerPlant:
        """Lay out the rollers' constants for the kernel."""
        geometry, tire = self.kinematics.geometry, self.configuration.tire
        jump = np.array([wheel.jump for wheel in self.geometries.values()])
        reach = np.linalg.norm(geometry.position - self.masses.centre, axis=1) + jump
        return roller_dynamics.RollerPlant(
            cosine=np.cos(geometry.roller_angle),
            sine=np.sin(geometry.roller_angle),
            axis=np.ascontiguousarray(geometry.rolling),
            mobility=len(reach) / self.masses.mass + reach * reach.sum() / self.masses.yaw_inertia,
            distance=geometry.radius - self.rollers.radius,
            curve_y=curve_coefficients(tire.y, tire.nominal_load_1, tire.nominal_load_2),
            inertia=self.rollers.inertia,
            overlap=self.rollers.overlap,
        )

    def place(self, pose: ArrayLike, twist: ArrayLike) -> None:
        """Put the vehicle somewhere, wheels and rollers turning as it moves, its tyres at rest.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: of base_link in the body frame [m/s, m/s, rad/s].
        """
        super().place(pose, twist)
        self._wheels[:, dynamics.ANGLE] = self._start_angle
        self._wrench[:] = 0.0
        self._rollers[:] = 0.0
        self._rollers[:, :, roller_dynamics.Q_A] = 1.0
        velocity = self.kinematics.wheel_velocities(np.asarray(twist, dtype=np.float64))
        geometry = self.kinematics.geometry
        # Eq. (29): what the wheel's own rolling leaves is rolled by the roller.
        across = np.sum(velocity * geometry.axis, axis=1)
        passive = across / np.sum(geometry.axis * geometry.passive, axis=1)
        squeeze = static_loads(self._plant) / self.configuration.tire.vertical_stiffness
        self._rollers[:, :, roller_dynamics.SPIN] = (passive / (self.rollers.radius - squeeze))[
            :, np.newaxis
        ]

    def _run(
        self, n_steps: int, control: dynamics.Control, wheels: FloatArray, energy: FloatArray
    ) -> FloatArray:
        if n_steps < 0:
            return super()._run(n_steps, control, wheels, energy)
        trajectory = np.empty((n_steps + 1, 6))
        before = int(self._counters[dynamics.TIPPING_STEPS])
        roller_dynamics.advance_rollers(
            self._plant,
            self._more,
            control,
            self._body,
            self._wheels,
            self._rollers,
            self._wrench,
            self._counters,
            trajectory,
            wheels,
            energy,
        )
        self._tipping = int(self._counters[dynamics.TIPPING_STEPS]) > before
        return trajectory

    @property
    def total_force(self) -> FloatArray:
        """Force [N] and moment about the centre of gravity [N m], body frame, shape (3,)."""
        return self._wrench.copy()

    @property
    def roller_spin(self) -> FloatArray:
        """Spin of the rollers about their axes [rad/s], shape (N, n)."""
        return self._rollers[:, :, roller_dynamics.SPIN].copy()

    @property
    def roller_force(self) -> FloatArray:
        """Forces along the rollers' axes and across them [N], shape (N, n, 2)."""
        f_a, f_p = roller_dynamics.F_A, roller_dynamics.F_P
        return self._rollers[:, :, f_a : f_p + 1].copy()

    @property
    def roller_load(self) -> FloatArray:
        """Vertical loads of the rollers [N], shape (N, n)."""
        return self._rollers[:, :, roller_dynamics.CARRIES].copy()

    @property
    def roller_limit(self) -> FloatArray:
        """Largest force that load, ground and direction allowed each roller [N], (N, n)."""
        return self._rollers[:, :, roller_dynamics.GRIP].copy()

    @property
    def kinetic_energy(self) -> float:
        """Energy of translation, rotation, and spin of wheels and rollers [J]."""
        spin = 0.5 * self.rollers.inertia * float(np.sum(self.roller_spin**2))
        return super().kinetic_energy + spin

    @property
    def elastic_energy(self) -> float:
        """Energy of the rollers' deflection [J]."""
        e_a, e_p = roller_dynamics.E_A, roller_dynamics.E_P
        deflection = self._rollers[:, :, e_a : e_p + 1]
        return float(0.5 * self.configuration.tire.stiffness * np.sum(deflection**2))


def _geometries(
    configuration: VehicleConfiguration, rollers: RollerConfiguration
) -> dict[str, RollerGeometry]:
    """Return the geometry of each wheel, refusing rollers that do not fit."""
    geometries = {}
    reach = math.cos(math.pi / rollers.count * (1.0 + rollers.overlap))
    squeeze = configuration.tire.nominal_load_2 / configuration.tire.vertical_stiffness
    for name, mount in configuration.wheels.items():
        distance = mount.radius - rollers.radius
        if distance <= 0.0 or mount.radius - distance / reach <= squeeze:
            least = mount.radius - (mount.radius - squeeze) * reach
            raise ConfigurationError(
                "rollers.radius",
                f"{rollers.radius:g} m leaves no room between the ground and the ends of the "
                f"{rollers.count} rollers of wheel {name}; between {least:.3g} m and "
                f"{mount.radius:g} m fit",
            )
        geometries[name] = RollerGeometry(
            alpha=math.radians(mount.heading_deg + 90.0),
            delta=math.radians(90.0 + mount.roller_angle_deg),
            distance=distance,
            radius=mount.radius,
            rollers=rollers.count,
            centre=(mount.x, mount.y),
        )
    return geometries
