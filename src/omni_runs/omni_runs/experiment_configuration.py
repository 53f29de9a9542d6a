"""Configuration of the whole loop: vehicle, sensors, odometry and assistant of one run."""

import dataclasses
from collections.abc import Iterable
from typing import Any

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.own_odometry import ODOMETRY_GROUP, own_odometry
from linescan_odometry.twist.least_squares import check_placement
from omni_brake_assist.configuration import LAWS, BrakeAssistConfiguration
from omni_brake_assist.laws.own_law import own_law
from omni_core import geometry, plugins
from omni_core.configuration import C, Configuration, ConfigurationError, parameter
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.mujoco_import import load_mujoco

FEEDBACKS = ("optical", "velocity_sensor")
"""Built-in sources of the twist for the brake assistant."""


def changed(one: C, **values: Any) -> C:
    """Return a copy of a configuration with other values.

    Args:
        one: the configuration.
        **values: new values; those of a nested configuration may be a dict of its new values.
    """
    for name, value in values.items():
        own = getattr(one, name)
        if isinstance(own, Configuration) and isinstance(value, dict):
            values[name] = changed(own, **value)
    return dataclasses.replace(one, **values)


class ExperimentConfiguration(SimulatorConfiguration):
    """All values on which a run of the closed loop depends."""

    description: str = parameter("")
    """Purpose of the experiment"""
    feedback: str = parameter("optical")
    """Source of the assistant's twist: `optical` for the line-scan odometry; `velocity_sensor` for
    the sampled velocity sensor with noise, Eqs. (60), (61); `my_module:MyOdometry` for your own
    class, see docs/extending.md"""
    odometry: OdometryConfiguration = parameter()
    """Line-scan odometry"""
    brake_assist: BrakeAssistConfiguration = parameter()
    """Brake assistant"""

    @property
    def uses_lines(self) -> bool:
        """Whether the brake assistant uses a twist that is computed from camera lines."""
        return self.feedback != "velocity_sensor"

    @property
    def twist_period(self) -> float:
        """Time between two twists for the brake assistant [s]; 0 for one at every control stamp."""
        return 0.0 if self.uses_lines else self.velocity_sensor.sample_time

    @property
    def imu_period_ns(self) -> int:
        """Time between two readings of an IMU with a rate of its own [ns]; otherwise 0."""
        return self.imu.period_ns(0)

    @property
    def own_odometry(self) -> str:
        """Name of the user's odometry class, empty for the built-in odometry."""
        return "" if self.feedback in FEEDBACKS else self.feedback

    def check_consistency(self) -> None:
        """Check that every message for which a node waits is published by another node.

        The names of wheels and line cameras must agree between nodes and vehicle. Configured
        positions may differ from the true positions, so that such errors can be studied.

        Raises:
            ConfigurationError: names of wheels or cameras differ, or the feedback is not suitable.
        """
        super().check_consistency()
        plugins.check_name("feedback", self.feedback, FEEDBACKS, ODOMETRY_GROUP)
        _check_names("brake_assist.wheels", self.brake_assist.wheels, self.vehicle.wheels)
        _check_names("odometry.sensors", self.odometry.sensors, self.sensors)
        _check_names("odometry.flow_sensors", self.odometry.flow_sensors, self.flow_sensors)
        rates = [sensor.rate for sensor in self.flow_sensors.values()]
        if not self.sensors and max(rates, default=0.0) * self.simulation.control_period < 1.0:
            raise ConfigurationError(
                "flow_sensors",
                "without line cameras, one flow sensor must measure in every control period of "
                f"{self.simulation.control_period:g} s; set its rate",
            )
        if self.uses_lines and not self.simulation.render_lines:
            raise ConfigurationError(
                "simulation.render_lines",
                "must be true for optical feedback; feedback=velocity_sensor needs no lines",
            )

    def check_fast_loop(self, *, own_source: bool) -> None:
        """Check that the compiled loop without cameras can run this experiment.

        Args:
            own_source: whether the twist comes from a function in Python.

        Raises:
            ConfigurationError: the feedback, the engine, the law or the wheels are unsuitable.
        """
        if self.feedback != "velocity_sensor":
            raise ConfigurationError(
                "feedback", f"is {self.feedback}, must be velocity_sensor in the fast loop"
            )
        if self.vehicle.wheel_model == "mujoco":
            raise ConfigurationError(
                "vehicle.wheel_model", "is mujoco, which the fast loop does not support"
            )
        if own_source and self.brake_assist.law not in LAWS:
            raise ConfigurationError(
                "brake_assist.law", "must be built in, as the source is in Python"
            )
        if list(self.brake_assist.wheels.items()) != list(self.vehicle.wheels.items()):
            raise ConfigurationError("brake_assist.wheels", "must be those of the vehicle")

    def check_drivable(self) -> None:
        """Check that the configured odometry, law and engine work on a simulated vehicle.

        An odometry with few cameras may need an axle that resists lateral slip. A recorded vehicle
        may have such an axle, so replays skip this check; a simulated vehicle has one if there are
        unsteered conventional wheels.

        Raises:
            ConfigurationError: the odometry needs such an axle, a user's law or odometry cannot be
                imported or created, or MuJoCo is not installed.
        """
        if self.vehicle.wheel_model == "mujoco":
            load_mujoco()
        own_law(self.brake_assist, geometry.PlatformGeometry.from_wheels(self.brake_assist.wheels))
        if self.own_odometry:
            own_odometry(self.own_odometry, self.odometry)
        odometry = self.odometry
        axle = odometry.kinematics.axle
        if self.feedback != "optical" or axle is None:
            return
        for mount in self.vehicle.wheels.values():
            if mount.kind == "conventional" and not mount.is_steered and mount.x == axle:
                return
        try:
            check_placement(odometry.all_sensors, odometry.minimum_lever)
        except ConfigurationError:
            raise ConfigurationError(
                "odometry.kinematics.constraint",
                f"no unsteered conventional wheel of this vehicle is at x = {axle:g} m, and wheels "
                "with rollers slip sideways, so no such axle can replace a sensor; "
                f"{', '.join(odometry.all_sensors)} must measure the twist by themselves",
            ) from None


def _check_names(key: str, names: Iterable[str], known: Iterable[str]) -> None:
    if set(names) != set(known):
        raise ConfigurationError(
            key, f"has the names {', '.join(names)}, must have: {', '.join(known)}"
        )
