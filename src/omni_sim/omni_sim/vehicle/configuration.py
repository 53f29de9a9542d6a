"""Configuration of the simulated vehicle: wheels, masses, tires, brakes, drive and suspension."""

import functools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from omni_core import geometry, quantities
from omni_core.brakes import BrakeConfiguration
from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    check_choice,
    parameter,
    section,
)
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY, LARGEST_OFFSET
from omni_sim.masses import (
    MAXIMUM_WHEELS,
    ForkConfiguration,
    MassConfiguration,
    MassProperties,
    support_polygon,
)
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.wheel.configuration import Motor, PassiveLossConfiguration
from omni_sim.wheel.roller_geometry import RollerConfiguration, RollerGeometry, roller_geometries


class DriveConfiguration(Configuration):
    """Motor drive of each wheel: a speed source behind a clutch (Appendix A).

    By default, the source is ideal within the torque of the clutch. All quantities are those at the
    wheel, after the gear.
    """

    clutch_threshold: float = parameter(0.05, above=0.0, maximum=1.0)
    """Pedal position at which the clutch opens"""
    stiffness: float = parameter(5000.0, unit="N m s/rad", minimum=0.0, maximum=1.0e6)
    """Torque of the engaged clutch divided by its speed difference"""
    max_torque: float = parameter(1500.0, unit="N m", minimum=0.0, maximum=1.0e6)
    """Limit on the torque of the engaged clutch, or of the motor's current"""
    max_power: float = parameter(0.0, unit="W", minimum=0.0, maximum=1.0e9)
    """Limit on the mechanical power (0: no limit)"""
    stall_torque: float = parameter(0.0, unit="N m", minimum=0.0, maximum=1.0e7)
    """Torque at rest at the largest voltage, without the limit `max_torque`; the back EMF reduces
    it in proportion to the speed (0: no limit)"""
    no_load_speed: float = parameter(0.0, unit="rad/s", minimum=0.0, maximum=1.0e4)
    """Speed at the largest voltage without torque; belongs to `stall_torque`"""
    current_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time constant of the current loop, with which the torque follows the speed controller"""

    def check_consistency(self) -> None:
        """Check that the limit by the voltage has both of its values.

        Raises:
            ConfigurationError: only one of stall torque and no-load speed is given.
        """
        if (self.stall_torque > 0.0) != (self.no_load_speed > 0.0):
            raise ConfigurationError(
                "no_load_speed", "belongs to stall_torque: give both, or neither"
            )

    @property
    def is_ideal(self) -> bool:
        """Whether the drive has neither lag nor limits except that of the torque."""
        return max(self.max_power, self.stall_torque, self.current_time) == 0.0

    def motor(self, physics_step: float) -> Motor:
        """Return the motor for the kernel; `physics_step` is the length of a step [s]."""
        lag = self.current_time
        return Motor(
            limit=self.max_torque,
            slope=self.stall_torque / self.no_load_speed if self.no_load_speed else math.inf,
            idling=self.no_load_speed or math.inf,
            response=-math.expm1(-physics_step / lag) if lag > 0.0 else 1.0,
        )


class WheelCondition(Configuration):
    """Difference of one wheel from all other wheels, such as a worn tire or a faulty brake."""

    friction: float = parameter(1.0, minimum=0.0, maximum=2.0)
    """Factor by which the friction between this wheel and the ground is multiplied"""
    brake: float = parameter(1.0, minimum=0.0, maximum=2.0)
    """Factor by which the torque of this wheel's brake is multiplied"""
    mounted: float = parameter(0.0, unit="m", minimum=-0.1, maximum=0.1)
    """Mounting height of this wheel relative to the other wheels; requires a suspension"""
    open_valve: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Smallest share of the pedal's pressure that the valve of this brake passes; 1 for a valve
    that cannot release the brake"""
    stuck_brake: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Share of its full torque that this brake exerts even when the pedal is not pressed"""
    onset: float = parameter(0.0, unit="s", minimum=0.0, maximum=3600.0)
    """Time from which `brake`, `open_valve` and `stuck_brake` have an effect"""


class SuspensionConfiguration(Configuration):
    """Springs between ground and chassis, one for each wheel; none by default."""

    stiffness: float = parameter(0.0, unit="N/m", minimum=0.0, maximum=1.0e8)
    """Vertical stiffness of each wheel with its suspension; 0 for no suspension: the wheel loads
    are those of a rigid chassis on equal springs, delayed by `load_transfer_time`"""
    damping_ratio: float = parameter(0.3, minimum=0.0, maximum=2.0)
    """Damping ratio of the chassis in heave"""
    pitch_inertia: float = parameter(0.0, unit="kg m^2", minimum=0.0, maximum=1.0e9)
    """Moment of inertia of body and load about the lateral axis through their center of gravity;
    0 to use that of a homogeneous box as long as the chassis"""
    roll_inertia: float = parameter(0.0, unit="kg m^2", minimum=0.0, maximum=1.0e9)
    """Moment of inertia of body and load about the longitudinal axis through their center of
    gravity; 0 to use that of a homogeneous box as wide as the chassis"""


_SOUND = WheelCondition()


class VehicleConfiguration(Configuration):
    """A vehicle on omni-wheels or conventional wheels: masses, wheels, tires, brakes and drive."""

    wheels: Mapping[str, geometry.WheelMount] = parameter()
    """Wheels, keyed by name; all arrays of wheel quantities have this order"""
    chassis_length: float = parameter(1.6, unit="m", minimum=1e-3, maximum=100.0)
    """Length of the chassis, for figures, stopping areas, the placement of sensors, and the pitch
    inertia of a chassis on springs"""
    chassis_width: float = parameter(1.2, unit="m", minimum=1e-3, maximum=100.0)
    """Width of the chassis, for figures, stopping areas, the placement of sensors, and the roll
    inertia of a chassis on springs"""
    chassis_x: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Center of the chassis, forward of base_link"""
    chassis_y: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Center of the chassis, left of base_link"""
    body: MassConfiguration = parameter()
    """Mass of the chassis including wheels and drives"""
    load: MassConfiguration = section(lambda: MassConfiguration(mass=0.0, height=0.0))
    """Movable load"""
    fork: ForkConfiguration = section(ForkConfiguration)
    """Fork that lifts the load during a run"""
    tire: TireConfiguration = section(TireConfiguration)
    """Tire of every wheel"""
    wheel_model: str = parameter("single", choices=("single", "rollers", "mujoco"))
    """Wheel model: `single` with one idealized roller (section 2.4.2), `rollers` with individual
    rollers (section 2.4.1), or `mujoco` with such rollers in MuJoCo, an optional package"""
    contact: str = parameter("ideal", choices=("ideal", "roller"))
    """Contact point of the wheel model `single`: `ideal` under the wheel's center, or `roller`,
    which moves along the roller on the ground and jumps to the next roller, Eqs. (8)-(10)"""
    rollers: RollerConfiguration = section(RollerConfiguration)
    """Rollers of every wheel; used if `wheel_model` or `contact` requires them"""
    brake: BrakeConfiguration = section(BrakeConfiguration)
    """Brake of every wheel"""
    drive: DriveConfiguration = section(DriveConfiguration)
    """Drive of every wheel"""
    conditions: Mapping[str, WheelCondition] = section(dict)
    """Differences of individual wheels from all other wheels, keyed by wheel name"""
    suspension: SuspensionConfiguration = section(SuspensionConfiguration)
    """Suspension of the chassis"""
    passive_losses: PassiveLossConfiguration = section(PassiveLossConfiguration)
    """Passive losses of the rollers of every wheel"""
    wheel_inertia: float = parameter(1.0, unit="kg m^2", minimum=1e-6, maximum=1.0e4)
    """Moment of inertia of a wheel about its axis"""
    load_transfer_time: float = parameter(0.02, unit="s", minimum=0.0, maximum=10.0)
    """Time constant with which the wheel loads follow the acceleration, for pitch and roll on the
    tires"""

    def by_wheel(self, field: str) -> quantities.FloatArray:
        """Return the values of one field of `WheelCondition` for all wheels, shape (N,)."""
        values = np.full(len(self.wheels), getattr(_SOUND, field))
        if self.conditions:
            conditions = (self.conditions.get(name, _SOUND) for name in self.wheels)
            values[:] = [getattr(condition, field) for condition in conditions]
        return values

    @property
    def chassis_size(self) -> quantities.FloatArray:
        """Length and width of the chassis [m], shape (2,)."""
        return np.array([self.chassis_length, self.chassis_width])

    @property
    def chassis_center(self) -> tuple[float, float]:
        """Center of the chassis in the body frame [m]."""
        return self.chassis_x, self.chassis_y

    @functools.cached_property
    def masses(self) -> MassProperties:
        """Mass properties of body and load together."""
        return MassProperties.of(self.body, self.load)

    def height_at(self, time: ArrayLike) -> quantities.FloatArray:
        """Return the height of the center of gravity of body and load [m] at times [s]."""
        lifted = np.zeros(np.shape(time))
        if self.fork.time:
            height = np.interp(np.asarray(time), self.fork.time, self.fork.height)
            lifted = self.load.mass / self.masses.mass * (height - self.load.height)
        return np.asarray(self.masses.height + lifted)

    @property
    def has_conventional_wheels(self) -> bool:
        """Whether at least one wheel has no rollers."""
        return any(mount.kind == "conventional" for mount in self.wheels.values())

    @property
    def is_steered(self) -> bool:
        """Whether at least one wheel is steered."""
        return any(mount.is_steered for mount in self.wheels.values())

    @property
    def contacts_move(self) -> bool:
        """Whether the contact points move along the rollers."""
        return self.wheel_model == "rollers" or self.contact == "roller"

    @property
    def roller_geometries(self) -> tuple[RollerGeometry, ...]:
        """Geometry of the rollers of each omni-wheel.

        Raises:
            ConfigurationError: the rollers do not fit on a wheel.
        """
        squeeze = self.tire.largest_load / self.tire.vertical_stiffness
        wheels = {name: mount for name, mount in self.wheels.items() if mount.kind == "omni"}
        return roller_geometries(wheels, self.rollers, squeeze)

    def check_consistency(self) -> None:
        """Check that the platform can move, and does not tip over at rest.

        Without conventional wheels, it must be able to move in all directions.

        The masses, the rollers and the options of the wheel model are also checked.

        Raises:
            ConfigurationError: a check fails; the message names the parameter.
        """
        for name in self.conditions:
            check_choice("conditions", name, self.wheels)
        kinematics = PlatformKinematics.of(self.wheels)
        self._check_conventional()
        if self.contacts_move or self.wheel_model == "mujoco":
            _ = self.roller_geometries  # raises if the rollers do not fit
        if self.wheel_model == "rollers" and self.passive_losses.roller_mass > 0.0:
            raise ConfigurationError(
                "passive_losses.roller_mass",
                "belongs to the wheel model 'single'; individual rollers have rollers.inertia",
            )
        if self.wheel_model == "mujoco":
            lacking = {
                "contact": self.contact != "ideal",
                "suspension.stiffness": self.suspension.stiffness > 0.0,
                "passive_losses": self.passive_losses.active,
                "brake.kind": self.brake.is_ramped,
                "fork": bool(self.fork.time),
                "drive": not self.drive.is_ideal,
                "wheels.steering_limit_deg": self.is_steered,
            }
            _refuse(lacking, "is not part of wheel_model 'mujoco'; use 'single', or leave it out")
        self._check_heights()
        if self.body.mass + self.load.mass <= 0.0:
            raise ConfigurationError("body.mass", "body and load together must have a mass")
        position = kinematics.geometry.position
        if len(position) > MAXIMUM_WHEELS:
            raise ConfigurationError("wheels", f"at most {MAXIMUM_WHEELS} wheels are supported")
        masses = self.masses
        if masses.yaw_inertia <= 0.0:
            raise ConfigurationError("body.yaw_inertia", "the vehicle must have a yaw inertia")
        hull = position[support_polygon(position)]
        edges = np.roll(hull, -1, axis=0) - hull
        inside = geometry.cross(edges, masses.center - hull) / np.linalg.norm(edges, axis=1)
        if len(hull) < 3 or float(np.min(inside)) <= 0.0:
            x, y = masses.center
            raise ConfigurationError(
                "body",
                f"the center of gravity at ({x:.3g}, {y:.3g}) m is not between the wheels, "
                "so the vehicle tips over; move body, load or wheels",
            )
        self._check_stiffness()

    def _check_stiffness(self) -> None:
        weight = self.masses.mass * GRAVITY
        for name, mount in self.wheels.items():
            if weight >= 0.5 * mount.radius * self.tire.vertical_stiffness:
                raise ConfigurationError(
                    "tire.vertical_stiffness",
                    f"the whole weight on wheel {name} would flatten it by more than half its "
                    "radius",
                )

    def _check_conventional(self) -> None:
        """Check that no option belongs to the rollers of all wheels if some have no rollers."""
        if not self.has_conventional_wheels:
            return
        rollers = {
            "wheel_model": self.wheel_model == "rollers",
            "contact": self.contact != "ideal",
            "passive_losses": self.passive_losses.active,
        }
        _refuse(rollers, "belongs to wheels with rollers, but some wheels have kind: conventional")

    def _check_heights(self) -> None:
        """Check that the model of the vehicle supports its mounting heights and roller gaps.

        Both require a suspension. Gaps also require moving contact points.
        """
        if self.suspension.stiffness == 0.0:
            uneven = {
                "conditions": bool(self.by_wheel("mounted").any()),
                "rollers.gap": self.rollers.gap > 0.0,
            }
            _refuse(uneven, "mounting heights require springs: set suspension.stiffness [N/m]")
        if self.rollers.gap > 0.0 and not self.contacts_move:
            raise ConfigurationError(
                "rollers.gap", "requires wheel_model 'rollers' or contact 'roller'"
            )


def _refuse(used: Mapping[str, bool], problem: str) -> None:
    """Raise `ConfigurationError` with a problem for the first parameter that is used."""
    for place in (place for place, has in used.items() if has):
        raise ConfigurationError(place, problem)
