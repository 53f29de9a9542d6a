"""The vehicle on individual-roller wheels: exchangeable for `vehicle.Vehicle`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_sim.tire.roller import passive_parameters
from omni_sim.vehicle import dynamics, roller_dynamics
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.roller_configuration import RollerConfiguration
from omni_sim.wheel.roller_geometry import U_X, U_Y, nearest_roller, roller_contact

FloatArray = NDArray[np.float64]


class RollerVehicle(Vehicle):
    """A vehicle whose wheels have free rollers; everything else is that of `Vehicle`.

    In logs and properties a wheel's force is the part of all its rollers' forces along the
    nominal active direction, and its limit is the sum of their limits; slip, deflection and
    whether it slides are those of its lower roller; the slip velocity is that of an ideal contact.
    """

    wheel_model = "rollers"

    @property
    def rollers(self) -> RollerConfiguration:
        """What the rollers are like."""
        return self.configuration.rollers

    def place(self, pose: ArrayLike, twist: ArrayLike) -> None:
        """Put the vehicle somewhere, wheels and rollers turning as it moves, its tires at rest.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: of base_link in the body frame [m/s, m/s, rad/s].
        """
        super().place(pose, twist)
        tire, rollers, n = self.configuration.tire, self.rollers, len(self._wheels)
        self._state = np.zeros((n, rollers.count, roller_dynamics.ROLLER_SIZE))
        self._state[:, :, roller_dynamics.Q_A] = 1.0
        self._state[:, :, roller_dynamics.SPIN] = self._rolling_spin()[:, np.newaxis]
        self._push = np.zeros((n, 3))
        self._individual_rollers = roller_dynamics.Rollers(
            tire_y=passive_parameters(tire),
            inertia=rollers.inertia,
            stiffness=rollers.stiffness,
            damping=rollers.damping,
            overlap=rollers.overlap,
            state=self._state,
            push=self._push,
        )
        self._contacts[:] = self._plant.wheel[:, : dynamics.CONTACT_SIZE]

    def _rolling_spin(self) -> FloatArray:
        """Return the spin [rad/s] with which each roller on the ground rolls, k of Eq. (13)."""
        rate, yaw = self._body[dynamics.YAW_RATE], self._body[dynamics.YAW]
        cos, sin = math.cos(yaw), math.sin(yaw)
        v_x, v_y = self.velocity_of_gravity_centre
        spin = np.empty(len(self._wheels))
        states = zip(self._wheels, self._plant.wheel, self._rolling_radius, strict=True)
        for i, (wheel, constants, radius) in enumerate(states):
            pitch = self._plant.roller_pitch
            angle = wheel[dynamics.ANGLE]
            gamma = angle - pitch * nearest_roller(angle, pitch)
            n_x, n_y, x, y, _, length, depth = roller_contact(gamma, self._plant.rollers[i])
            r_x, r_y = constants[dynamics.R_X] + x, constants[dynamics.R_Y] + y
            rim = radius * wheel[dynamics.SPEED]
            slip_x = cos * v_x + sin * v_y - rate * r_y - rim * self._plant.rollers[i, U_X]
            slip_y = cos * v_y - sin * v_x + rate * r_x - rim * self._plant.rollers[i, U_Y]
            spin[i] = (slip_x * n_y - slip_y * n_x) / ((radius - depth) * length)
        return spin

    @property
    def wheel_force_body(self) -> FloatArray:
        """Forces of the wheels on the vehicle in the body frame [N], shape (N, 2)."""
        return self._push[:, :2].copy()

    @property
    def roller_spin(self) -> FloatArray:
        """Spin of the rollers about their axes [rad/s], shape (N, n)."""
        return self._state[:, :, roller_dynamics.SPIN].copy()

    @property
    def roller_force(self) -> FloatArray:
        """Forces along the rollers' axes and across them [N], shape (N, n, 2)."""
        f_a, f_p = roller_dynamics.F_A, roller_dynamics.F_P
        return self._state[:, :, f_a : f_p + 1].copy()

    @property
    def roller_load(self) -> FloatArray:
        """Vertical loads of the rollers [N], shape (N, n)."""
        return self._state[:, :, roller_dynamics.CARRIES].copy()

    @property
    def roller_limit(self) -> FloatArray:
        """Largest force that load, ground and direction allowed each roller [N], (N, n)."""
        return self._state[:, :, roller_dynamics.GRIP].copy()

    @property
    def kinetic_energy(self) -> float:
        """Energy of translation, rotation, and spin of wheels and rollers [J]."""
        spin = 0.5 * self.rollers.inertia * float(np.sum(self.roller_spin**2))
        return super().kinetic_energy + spin

    @property
    def elastic_energy(self) -> float:
        """Energy of the rollers' deflection [J]."""
        e_a, e_p = roller_dynamics.E_A, roller_dynamics.E_P
        deflection = self._state[:, :, e_a : e_p + 1]
        return float(0.5 * self.rollers.stiffness * np.sum(deflection**2))
