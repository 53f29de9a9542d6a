"""Switching of the wheels between the drive controller and the controller of the brakes.

While the vehicle does not brake, the drive controller of `ros2_control`, such as
mecanum_drive_controller, keeps the wheels and their odometry. While it brakes, the controller that
forwards the commands of the brake adapter has them. The controller manager switches both in one of
its cycles. Its messages are imported only if this is configured, because the packages of ROS from
PyPI do not contain them.
"""

import importlib
import math
from typing import Any

from omni_core.configuration import Configuration, ConfigurationError, parameter


class SwitchConfiguration(Configuration):
    """Controllers between which the controller manager switches."""

    drive_controller: str = parameter("")
    """Controller that drives the wheels while no braking is demanded, such as
    mecanum_drive_controller; empty if no controller is switched"""
    brake_controller: str = parameter("")
    """Controller that receives the topic commands, active only while braking is demanded; empty if
    it is always active, because it commands other interfaces"""
    controller_manager: str = parameter("controller_manager")
    """Name of the controller manager, relative to the namespace of the node"""
    switch_timeout: float = parameter(0.5, unit="s", above=0.0, maximum=10.0)
    """Limit on the time until the controller manager answers, and time until a refused request is
    repeated"""

    def check_consistency(self) -> None:
        """Check that there is a drive controller to switch to."""
        if self.brake_controller and not self.drive_controller:
            raise ConfigurationError("brake_controller", "needs the parameter drive_controller")


class ControllerSwitch:
    """Requests the controllers that the braking demand needs, one request at a time."""

    def __init__(self, configuration: SwitchConfiguration, node: Any) -> None:
        """Create the client of the controller manager.

        Args:
            configuration: controllers to switch.
            node: ROS node that owns the client.

        Raises:
            ConfigurationError: the messages of the controller manager are not installed.
        """
        try:
            service = importlib.import_module("controller_manager_msgs.srv").SwitchController
        except ImportError:
            raise ConfigurationError(
                "drive_controller",
                "needs the messages of the controller manager (controller_manager_msgs), which "
                "come with ros2_control: source its installation before ./omni",
            ) from None
        self._configuration = configuration
        self._request = service.Request
        self._client = node.create_client(
            service, f"{configuration.controller_manager}/switch_controller"
        )
        self._answer: Any = None  # future of the request that is under way
        self._asked = False  # demand of that request
        self._active: bool | None = None  # demand whose controllers are active, None if unknown
        self._next = -math.inf  # time of the next request, or limit on the answer [s]
        self._problem = ""

    def follow(self, braking: bool, now: float) -> str:
        """Request the controllers for a demand; return the problem if they are not active.

        Args:
            braking: whether braking is demanded.
            now: present time on a steady clock [s].
        """
        if self._answer is not None:
            self._take_answer(now)
        if self._answer is None and self._active != braking and now >= self._next:
            self._ask(braking, now)
        return "" if self._active == braking else self._problem

    def _ask(self, braking: bool, now: float) -> None:
        given = self._configuration
        self._next = now + given.switch_timeout
        if not self._client.service_is_ready():
            self._problem = f"there is no controller manager {given.controller_manager}"
            return
        brake = [given.brake_controller] if given.brake_controller else []
        drive = [given.drive_controller]
        request = self._request(activate_asap=True)
        request.activate_controllers, request.deactivate_controllers = (
            (brake, drive) if braking else (drive, brake)
        )
        # Strict: both or none. A strict request also fails if nothing is to be changed, so it is
        # sent only if the active controllers are known.
        known = self._active is not None
        request.strictness = self._request.STRICT if known else self._request.BEST_EFFORT
        self._asked, self._answer = braking, self._client.call_async(request)

    def _take_answer(self, now: float) -> None:
        name = self._configuration.controller_manager
        if self._answer.done():
            answer = self._answer.result()
            if answer.ok:
                self._active, self._problem, self._next = self._asked, "", now
            else:
                wanted = "brake" if self._asked else "drive"
                words = getattr(answer, "message", "") or "no reason given"
                self._problem = f"{name} does not switch to the {wanted} controller: {words}"
        elif now >= self._next:
            self._client.remove_pending_request(self._answer)
            self._active, self._problem = None, f"{name} does not answer"
        else:
            return
        self._answer = None
