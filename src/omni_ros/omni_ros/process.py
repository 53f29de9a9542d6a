"""Start, spin, stop and exit code of a node as an operating-system process.

Signals only set a flag that the spin loop watches, so that a node that is asked to stop can still
publish, drain its queues and close its files. (rclpy's own handlers would invalidate the context
at once.)
"""

from __future__ import annotations

import ctypes
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from omni_platform.configuration import ConfigurationError
from omni_platform.exit_codes import ExitCode
from omni_ros import environment, parameters

_POLL = 0.05  # [s] longest time until a signal is noticed while no message arrives


class NodeError(Exception):
    """A node cannot go on; the message gives the reason."""


class MatchTimeoutError(NodeError):
    """An expected subscription or publisher has not appeared in time."""


class StopFlag:
    """Flag that is set by SIGINT, SIGTERM or SIGHUP."""

    def __init__(self) -> None:
        self._requested = False
        self._terminations = 0
        self.is_interrupt = False  # set by SIGINT: a person, or ros2 launch, waits for the end

    def __bool__(self) -> bool:
        return self._requested

    @property
    def is_insistent(self) -> bool:
        """Whether SIGTERM was received again, so that the node must not wait any longer.

        SIGINT does not count: a terminal and a launcher may both pass on the same Ctrl-C.
        """
        return self._terminations > 1

    def request(self, number: int = signal.SIGINT, *_: object) -> None:
        """Request the stop; usable as a signal handler."""
        self._requested = True
        self.is_interrupt |= number == signal.SIGINT
        self._terminations += number == signal.SIGTERM


def run_process(make_node: Callable[[], Node], run: Callable[[Node, Spinner], None]) -> int:
    """Run one node until its work is done or a signal asks it to stop.

    Args:
        make_node: creates the node; its `ConfigurationError` ends the process with one sentence.
        run: the node's work, usually `spin_until_stopped`.

    Returns:
        Exit code: 0 done or stopped, 1 failed, 2 bad configuration.
    """
    _end_with_parent()
    stop = StopFlag()
    # A node that is still being created has nothing to finish, and creating it may take seconds.
    _on_signals(lambda *_: os._exit(ExitCode.OK))
    node: Node | None = None
    try:
        _initialize_ros()
        node = _make(make_node)
        _on_signals(stop.request)
        run(node, Spinner(node, stop))
    except ConfigurationError as error:
        print(error, file=sys.stderr, flush=True)
        return ExitCode.REFUSED
    except NodeError as error:
        print(error, file=sys.stderr, flush=True)
        return ExitCode.FAILED
    finally:
        if node is not None:
            _flush_publishers(node, stop)
            node.destroy_node()
        rclpy.try_shutdown()
    return ExitCode.OK


def _on_signals(handler: Callable[..., None]) -> None:
    # When the bring-up has died, the kernel wakes a stopped node with SIGHUP.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, handler)


def _initialize_ros() -> None:
    """Start the client library.

    Raises:
        ConfigurationError: the domain, an argument or a parameter file cannot be used.
    """
    environment.name_log_folder(os.environ)
    environment.chosen_domain(os.environ)  # Fast DDS ends the process if the domain is too large
    try:
        surplus = remove_ros_args(sys.argv)[1:]  # first: it does not log what it then raises
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise ConfigurationError("--ros-args", f"unknown: {error}") from None
    except RuntimeError as error:
        # Remove the positions in the source code of rcl.
        words = " ".join(re.sub(r", at \S+:\d+", "", str(error)).split())
        words = re.sub("^(failed to initialize rcl|Failed to parse ROS arguments): ", "", words)
        raise ConfigurationError("--ros-args", words) from None
    if surplus:
        raise ConfigurationError(
            "arguments", f"unknown: {' '.join(surplus)}; arguments for ROS follow --ros-args"
        )


def _make(make_node: Callable[[], Node]) -> Node:
    try:
        node = make_node()
    except ParameterException as error:  # raised for a parameter of rclpy itself
        raise ConfigurationError("", str(error)) from None
    try:
        parameters.refuse_unknown_parameters(node)
    except ConfigurationError:
        node.destroy_node()
        raise
    return node


class Spinner:
    """Runs a node's callbacks on the events executor.

    `EventsExecutor.spin()` and ``spin_once(None)`` of rclpy 7 do not return on signals; short
    waits in a loop do.
    """

    def __init__(self, node: Node, stop: StopFlag) -> None:
        self._executor = EventsExecutor()
        self._executor.add_node(node)
        self.stop = stop

    def spin_once(self, timeout: float = _POLL) -> None:
        """Run the callbacks that are due, waiting for the first at most `timeout` [s]."""
        self._executor.spin_once(timeout_sec=timeout)

    def spin_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Run callbacks until `condition()`, a stop request, or `timeout` [s] passed.

        Returns:
            Whether the condition holds.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            remaining = deadline - time.monotonic()
            if self.stop or remaining <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(remaining, _POLL))
        return True


def spin_until_stopped(_node: Node, spinner: Spinner) -> None:
    """Run a node's callbacks until a signal asks it to stop."""
    while not spinner.stop:
        spinner.spin_once()


def await_subscribers(
    publishers: Iterable[Publisher], count: int, spinner: Spinner, timeout: float
) -> None:
    """Wait until every publisher has `count` subscriptions, so that none misses a message.

    Args:
        publishers: publishers to wait for.
        count: subscriptions that each must have.
        spinner: runs callbacks meanwhile and notices a stop request.
        timeout: longest wait [s].

    Raises:
        MatchTimeoutError: names the topic without a subscription.
    """
    for publisher in publishers:
        deadline = time.monotonic() + timeout
        # Discovery runs in DDS threads and wakes no executor, so this polls.
        while publisher.get_subscription_count() < count and not spinner.stop:
            if time.monotonic() > deadline:
                raise MatchTimeoutError(
                    f"{publisher.topic_name} has {publisher.get_subscription_count()} of {count} "
                    f"expected subscribers after {timeout:g} s; is the subscribing node running "
                    f"in the same ROS domain?"
                )
            time.sleep(0.005)


def _end_with_parent() -> None:
    """Ask the kernel for SIGTERM when the process that started the graph dies.

    This is done only if `PARENT_PID_VARIABLE`, which the bring-up sets, names that process. A node
    started by hand continues after its shell ends, as usual.
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
    """Let reliable data reach its readers before the process exits.

    A retransmission takes 3 s with the middleware's defaults, and a dead reader never
    acknowledges. A writer cannot distinguish these two cases. So a process that knows that no
    reader is left sends SIGTERM once more to end the wait.
    """
    # After SIGINT a person waits for the end.
    deadline = time.monotonic() + (interrupted if stop.is_interrupt else longest)  # [s]
    step = Duration(nanoseconds=int(_POLL * 1e9))  # short, so that signals are noticed
    for publisher in node.publishers:
        while not publisher.wait_for_all_acked(step):
            if stop.is_insistent or time.monotonic() >= deadline:
                return
