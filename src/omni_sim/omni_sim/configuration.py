"""Configuration of the simulator: vehicle, ground, sensors, maneuver and time steps."""

from collections.abc import Mapping

from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    check_choice,
    parameter,
    section,
)
from omni_core.geometry import WheelMount
from omni_core.quantities import CONTROL_PERIOD, SECOND_NS
from omni_core.sensors import FlowSensor, LineSensor, Mount
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.camera.optics import check_exposure
from omni_sim.driver.configuration import ManeuverConfiguration
from omni_sim.flow_sensor import FlowConfiguration, check_flow_sensors
from omni_sim.ground.configuration import ElevationConfiguration, FrictionPatch
from omni_sim.sensor_configuration import (
    EncoderConfiguration,
    FaultConfiguration,
    ImuConfiguration,
    VelocitySensorConfiguration,
)
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration


class GroundConfiguration(Configuration):
    """Friction, elevation and texture of the ground."""

    texture: TextureConfiguration = section(TextureConfiguration)
    """Texture of the ground"""
    friction: float = parameter(1.0, minimum=0.0, maximum=2.0)
    """Friction factor mu/mu_0 of the ground, relative to the friction in the tire data"""
    patches: Mapping[str, FrictionPatch] = section(dict)
    """Patches of ground with different friction, keyed by name"""
    elevation: ElevationConfiguration = section(ElevationConfiguration)
    """Height of the ground; flat by default"""


class SimulationConfiguration(Configuration):
    """Time steps, end and rendering of a simulation."""

    physics_step: float = parameter(0.0005, unit="s", minimum=1e-6, maximum=0.01)
    """Fixed time step of the physics"""
    control_period: float = parameter(CONTROL_PERIOD, unit="s", minimum=1e-4, maximum=1.0)
    """Time between two control steps"""
    duration_limit: float = parameter(30.0, unit="s", above=0.0, maximum=3600.0)
    """Limit on the duration of a run"""
    settling_time: float = parameter(0.5, unit="s", minimum=0.0, maximum=60.0)
    """Time at rest after which the run ends"""
    rest_speed: float = parameter(0.05, unit="m/s", above=0.0, maximum=1.0)
    """Speed below which the vehicle is regarded as at rest"""
    render_lines: bool = parameter(True)
    """Whether lines of the cameras are rendered and flow sensors are read; if not, the odometry
    receives no measurements"""

    @property
    def control_period_ns(self) -> int:
        """Control period [ns]."""
        return round(self.control_period * SECOND_NS)

    @property
    def steps_per_period(self) -> int:
        """Number of physics steps in a control period."""
        return round(self.control_period / self.physics_step)

    def check_consistency(self) -> None:
        """Check that the control period is a multiple of the physics step.

        Raises:
            ConfigurationError: the control period is not such a multiple; the message states both
                times.
        """
        if abs(self.steps_per_period * self.physics_step - self.control_period) > 1e-12:
            raise ConfigurationError(
                "control_period",
                f"{self.control_period:g} s is not a multiple of the physics step of "
                f"{self.physics_step:g} s",
            )


class SimulatorConfiguration(Configuration):
    """Configuration of a simulator: vehicle, ground, sensors and maneuver."""

    seed: int = parameter(1, minimum=0)
    """Seed of all random numbers"""
    vehicle: VehicleConfiguration = parameter()
    """Vehicle that is simulated"""
    ground: GroundConfiguration = section(GroundConfiguration)
    """Ground under the vehicle"""
    sensors: Mapping[str, LineSensor] = parameter()
    """Line cameras, keyed by name"""
    camera: CameraConfiguration = section(CameraConfiguration)
    """Exposure and optics of all line cameras"""
    flow_sensors: Mapping[str, FlowSensor] = section(dict)
    """Optical-flow sensors, keyed by name"""
    flow: FlowConfiguration = section(FlowConfiguration)
    """Errors of all flow sensors"""
    maneuver: ManeuverConfiguration = section(ManeuverConfiguration)
    """Demands of the scripted driver"""
    velocity_sensor: VelocitySensorConfiguration = section(VelocitySensorConfiguration)
    """Simulated velocity sensor with noise and sampling"""
    imu: ImuConfiguration = section(ImuConfiguration)
    """Inertial measurement unit"""
    encoders: EncoderConfiguration = section(EncoderConfiguration)
    """Wheel encoders"""
    faults: Mapping[str, FaultConfiguration] = section(dict)
    """Faults of velocity sensor, IMU and encoders, keyed by name"""
    simulation: SimulationConfiguration = section(SimulationConfiguration)
    """Time steps and end of the simulation"""

    def check_consistency(self) -> None:
        """Check line rates, carriers, exposure times and the duration of the run.

        Each camera must deliver at least two lines in every control period. The exposure of a
        camera must not be longer than its line period. The IMU must not take several readings in a
        physics step. The run must not end before the last demand of the driver.

        Raises:
            ConfigurationError: a check fails; the message names the sensor or the duration.
        """
        for name, sensor in self.sensors.items():
            if sensor.line_rate * self.simulation.control_period < 2.0:
                raise ConfigurationError(
                    f"sensors.{name}.line_rate",
                    f"{sensor.line_rate:g} 1/s gives fewer than two lines per control period of "
                    f"{self.simulation.control_period:g} s",
                )
        self._check_carriers()
        for name, fault in self.camera.faults.items():
            if fault.camera:
                check_choice(f"camera.faults.{name}.camera", fault.camera, self.sensors)
        check_exposure(self.sensors, self.camera)
        check_flow_sensors(self.flow_sensors, self.flow, self.simulation.control_period)
        if self.imu.rate * self.simulation.physics_step > 1.0:
            raise ConfigurationError(
                "imu.rate",
                f"{self.imu.rate:g} Hz is more than one reading per physics step of "
                f"{self.simulation.physics_step:g} s, must be at most "
                f"{1.0 / self.simulation.physics_step:g} Hz",
            )
        last = self.maneuver.earliest_end
        if last > self.simulation.duration_limit:
            raise ConfigurationError(
                "simulation.duration_limit",
                f"{self.simulation.duration_limit:g} s is before the end of the driver's "
                f"demands at {last:g} s; increase it",
            )

    def _check_carriers(self) -> None:
        """Check that each carrier is a steered wheel at the configured position."""
        for name in self.flow_sensors:
            if self.flow_sensors[name].carrier:
                raise ConfigurationError(
                    f"flow_sensors.{name}.carrier", "only line cameras can be on a steered carrier"
                )
        check_carriers(self.sensors, self.vehicle.wheels)


def check_carriers(sensors: Mapping[str, Mount], wheels: Mapping[str, WheelMount]) -> None:
    """Check that each carrier of a sensor is a steered wheel at the configured position.

    Raises:
        ConfigurationError: a carrier is not a steered wheel, or its position is not the wheel's.
    """
    steered = {name: mount for name, mount in wheels.items() if mount.is_steered}
    for name, sensor in sensors.items():
        if not sensor.carrier:
            continue
        check_choice(f"sensors.{name}.carrier", sensor.carrier, steered)
        wheel = steered[sensor.carrier]
        if (sensor.carrier_x, sensor.carrier_y) != (wheel.x, wheel.y):
            raise ConfigurationError(
                f"sensors.{name}.carrier_x",
                f"the steering axis is at ({sensor.carrier_x:g}, {sensor.carrier_y:g}) m, but "
                f"wheel {sensor.carrier} is at ({wheel.x:g}, {wheel.y:g}) m",
            )
