"""Start, spinning, stop and exit code of a node as an operating-system process.

Signals only set a flag that the spin loop checks. A node that is requested to stop can therefore
still publish, drain its queues and close its files; rclpy's own handlers would invalidate the
context immediately.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args

from omni_core.commands.exit_codes import ExitCode
from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_ros import environment, parameters

_POLL = 0.05  # s; longest time until a signal is noticed without a message
# s; longest time from a signal to the end of a node's construction, below the stop timeouts of
# the bring-up (12 s) and of ros2 launch (5 s)
_CONSTRUCTION_TIMEOUT = 2.0


class NodeError(Exception):
    """A node cannot continue; the message states the reason."""


class StopFlag:
    """Flag that is set when the process receives SIGINT, SIGTERM or SIGHUP."""

    def __init__(self) -> None:
        self._requested = False
        self._terminations = 0
        self.is_interrupt = False  # set by SIGINT: a person or ros2 launch waits for the end

    def __bool__(self) -> bool:
        return self._requested

    @property
    def is_insistent(self) -> bool:
        """Whether SIGTERM was received twice, which requires the node to stop without waiting.

        SIGINT does not count, since both a terminal and a launcher may pass on the same Ctrl-C.
        """
        return self._terminations > 1

    def request(self, number: int = signal.SIGINT, *_: object) -> None:
        """Set the flag; this function can be used as a signal handler."""
        self._requested = True
        self.is_interrupt |= number == signal.SIGINT
        self._terminations += number == signal.SIGTERM


def run_process(make_node: Callable[[], Node], run: Callable[[Node, Spinner], None]) -> int:
    """Run one node until its work is done or a signal requests shutdown.

    Args:
        make_node: function that creates the node; its `ConfigurationError` ends the process with a
            message.
        run: function that does the work of the node, usually `spin_until_stopped`.

    Returns:
        Exit code: 0 done or stopped, 1 failed, 2 invalid configuration.
    """
    _end_with_parent()
    stop = StopFlag()
    node: Node | None = None
    try:
        with _limited_construction(stop):
            _initialize_ros()
            node = _make(make_node)
        run(node, Spinner(node, stop))
    except (ConfigurationError, NodeError) as error:
        print(error, file=sys.stderr, flush=True)
        return ExitCode.FAILED if isinstance(error, NodeError) else ExitCode.REFUSED
    finally:
        if node is not None:
            _flush_publishers(node, stop)
            node.destroy_node()
        rclpy.try_shutdown()
    return ExitCode.OK


@contextlib.contextmanager
def _limited_construction(stop: StopFlag) -> Iterator[None]:
    """Limit the time for which the construction of a node continues after a signal.

    A subscription acknowledges messages before the construction of its node ends. If a signal ended
    the process at once, these messages would be lost. After a signal, the construction within the
    `with` block therefore continues; if it exceeds `_CONSTRUCTION_TIMEOUT`, the process ends.
    """

    def request(number: int, *_: object) -> None:
        if not stop:
            signal.setitimer(signal.ITIMER_REAL, _CONSTRUCTION_TIMEOUT)
        stop.request(number)

    signal.signal(signal.SIGALRM, lambda *_: os._exit(ExitCode.OK))
    _on_signals(request)
    try:
        yield
    finally:
        _on_signals(stop.request)
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _on_signals(handler: Callable[..., None]) -> None:
    # When the bring-up dies, the kernel wakes a halted node and sends it SIGHUP.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, handler)


def _initialize_ros() -> None:
    """Start the client library.

    Raises:
        ConfigurationError: an environment variable, an argument or a parameter file cannot be used.
    """
    environment.name_log_folder(os.environ)
    environment.chosen_domain(os.environ)  # Fast DDS would end the process
    environment.check_participant(os.environ)
    try:
        surplus = remove_ros_args(sys.argv)[1:]  # before rclpy.init, which would log the error
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise ConfigurationError("--ros-args", f"unknown: {error}") from None
    except RuntimeError as error:
        # Remove source code positions of rcl from the message.
        words = " ".join(re.sub(r", at \S+:\d+", "", str(error)).split())
        words = re.sub("^(failed to initialize rcl|Failed to parse ROS arguments): ", "", words)
        raise ConfigurationError("--ros-args", words) from None
    if surplus:
        raise ConfigurationError(
            "arguments", f"unknown: {' '.join(surplus)}; put arguments for ROS after --ros-args"
        )


def _make(make_node: Callable[[], Node]) -> Node:
    try:
        node = make_node()
    except (NameValidationException, ParameterException) as error:
        # The message marks the first invalid letter with a caret on a line of its own.
        raise ConfigurationError("", " ".join(str(error).rstrip(" ^").split())) from None
    try:
        parameters.refuse_unknown_parameters(node)
    except ConfigurationError:
        node.destroy_node()
        raise
    return node


class Spinner:
    """Runs the callbacks of a node with the events executor.

    `EventsExecutor.spin()` and ``spin_once(None)`` of rclpy 7 do not return on signals, but short
    waits in a loop do.
    """

    def __init__(self, node: Node, stop: StopFlag) -> None:
        self._executor = EventsExecutor()
        self._executor.add_node(node)
        self.stop = stop

    def spin_once(self, timeout: float = _POLL) -> None:
        """Run the callbacks that are due; wait for the first one at most `timeout` [s]."""
        self._executor.spin_once(timeout_sec=timeout)

    def spin_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Run callbacks until `condition()` is true, a stop is requested or `timeout` [s] passes.

        Returns:
            Whether the condition is true at the end.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            remaining = deadline - time.monotonic()
            if self.stop or remaining <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(remaining, _POLL))
        return True


class StartupConfiguration(Configuration):
    """Subscriptions that must exist before a node publishes, so that no message is missed."""

    subscribers: int = parameter(0, minimum=0, maximum=100)
    """Number of subscriptions that each output must have before the node starts to work; outputs of
    simulator and assistant that only a recorder awaits need one less"""
    match_timeout: float = parameter(20.0, unit="s", above=0.0, maximum=3600.0)
    """Limit on the time to wait for these subscriptions"""

    def await_subscribers(
        self, publishers: Iterable[Publisher], spinner: Spinner, count: int | None = None
    ) -> None:
        """Wait until each publisher has `count` subscriptions, so that no message is missed.

        Args:
            publishers: publishers to wait for.
            spinner: spinner, which notices a request to stop.
            count: number of subscriptions that each publisher must have; None for the value of the
                parameter `subscribers`.

        Raises:
            NodeError: a topic has too few subscriptions; the message names the topic.
        """
        count = self.subscribers if count is None else count
        for publisher in publishers:
            matched = publisher.get_subscription_count
            self._await(publisher.topic_name, matched, count, "subscribers", spinner)

    def await_publisher(self, subscription: Subscription, spinner: Spinner) -> None:
        """Wait until a subscription has a publisher, so that its first message is not missed.

        A node that waits for no subscriber does not wait for a publisher either.

        Args:
            subscription: subscription to wait for.
            spinner: spinner, which notices a request to stop.

        Raises:
            NodeError: the topic has no publisher; the message names the topic.
        """
        matched, count = subscription.get_publisher_count, min(self.subscribers, 1)
        self._await(subscription.topic_name, matched, count, "publishers", spinner)

    def _await(
        self, topic: str, matched: Callable[[], int], count: int, kind: str, spinner: Spinner
    ) -> None:
        deadline = time.monotonic() + self.match_timeout
        # Discovery runs in DDS threads and does not wake the executor, so the count is polled.
        while matched() < count and not spinner.stop:
            if time.monotonic() > deadline:
                raise NodeError(
                    f"{topic} has {matched()} of {count} expected {kind} after "
                    f"{self.match_timeout:g} s; does the other node run in the same ROS domain?"
                )
            time.sleep(0.005)


def spin_until_stopped(_node: Node, spinner: Spinner) -> None:
    """Run the callbacks of a node until a signal requests shutdown."""
    while not spinner.stop:
        spinner.spin_once()


def _end_with_parent() -> None:
    """Make the operating system send SIGTERM to this process when its parent process ends.

    This is done only if the bring-up has started this process and set `PARENT_PID_VARIABLE`. A node
    that was started by hand continues after its shell ends, as usual.
    """
    parent = os.environ.get(environment.PARENT_PID_VARIABLE)
    if parent is None:
        return
    pr_set_pdeathsig = 1  # <linux/prctl.h>
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)
    if os.getppid() != int(parent):  # the parent died before the request was made
        sys.exit(ExitCode.FAILED)


def _flush_publishers(
    node: Node, stop: StopFlag, longest: float = 5.0, interrupted: float = 0.3
) -> None:
    """Wait until the readers have acknowledged all reliable messages, before the process exits.

    The wait lasts at most `longest` [s], or `interrupted` [s] after Ctrl-C. If an acknowledgment is
    missing, the middleware may be repeating the message, which takes 3 s with its defaults, or the
    reader may be dead. A writer cannot distinguish these two cases. A process that starts nodes and
    knows that no reader is left therefore sends a second SIGTERM to end the wait.
    """
    # After Ctrl-C, a person is waiting for the process to end.
    deadline = time.monotonic() + (interrupted if stop.is_interrupt else longest)  # [s]
    step = Duration(nanoseconds=int(_POLL * 1e9))  # short, so that signals are noticed
    for publisher in node.publishers:
        while not publisher.wait_for_all_acked(step):
            if stop.is_insistent or time.monotonic() >= deadline:
                return
