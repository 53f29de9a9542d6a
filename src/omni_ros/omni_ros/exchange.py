"""Exchange of messages between two processes, to check the middleware."""

import os
from collections.abc import Mapping

import rclpy
from rclpy.node import Node
from std_msgs.msg import String

_WAIT = 0.05  # time between two messages of a node [s]
_SPARE = 20  # number of messages that a node publishes after it has received the first one


def exchange_messages(environment: Mapping[str, str]) -> None:
    """Exchange messages between two nodes, of which one is in a fork of this process.

    The process leads a new process group, and ends with exit code 0 after both nodes have received
    a message.

    Args:
        environment: environment variables of the nodes.
    """
    os.setsid()
    os.environ.clear()
    os.environ.update(environment)
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    other = os.fork()
    own, its = ("a", "b") if other else ("b", "a")
    rclpy.init()
    node = Node(f"doctor_{own}", enable_rosout=False, start_parameter_services=False)
    received: list[String] = []
    node.create_subscription(String, f"doctor_{its}", received.append, 1)
    publisher = node.create_publisher(String, f"doctor_{own}", 1)
    spare = _SPARE
    while rclpy.ok() and spare:
        publisher.publish(String())
        rclpy.spin_once(node, timeout_sec=_WAIT)
        spare -= bool(received)
    os._exit(os.waitpid(other, 0)[1] != 0 if other else 0)
