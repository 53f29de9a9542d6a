"""Options of every command that runs the loop: overrides and user classes."""

from omni_core import configuration
from omni_core.commands import command_options


class LoopOptions(configuration.Configuration):
    """Command-line options that override values of an experiment."""

    overrides: tuple[str, ...] = command_options.overrides_option()
    law: str | None = command_options.option(None, metavar="NAME")
    """control law: a built-in law, or your own as `my_module:MyLaw`; equivalent to
    --set brake_assist.law="""
    odometry: str | None = command_options.option(None, metavar="MODULE:CLASS")
    """your own odometry class, which receives rendered camera lines; equivalent to --set
    feedback="""

    simulator: str | None = command_options.option(None, choices=("single", "rollers", "mujoco"))
    """wheel model of the vehicle; equivalent to --set vehicle.wheel_model="""

    @property
    def changes(self) -> list[str]:
        """Overrides of all options as ``dotted.key=value`` texts."""
        law = [f"brake_assist.law={self.law}"] if self.law is not None else []
        odometry = [f"feedback={self.odometry}"] if self.odometry is not None else []
        simulator = [f"vehicle.wheel_model={self.simulator}"] if self.simulator is not None else []
        return [*law, *odometry, *simulator, *self.overrides]

    @property
    def swept(self) -> bool:
        """Whether at least one of the overrides contains several values."""
        return any(map(is_swept, self.changes))


def is_swept(override: str) -> bool:
    """Return whether a ``dotted.key=value`` text contains several values."""
    _, _, value = override.partition("=")
    return "," in value and not value.lstrip().startswith(("[", "{", '"', "'"))
