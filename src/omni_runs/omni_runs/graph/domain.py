"""Reservation of a ROS domain for each run, so that runs on one machine do not interfere."""

import contextlib
import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from omni_core.configuration import ConfigurationError, InputError
from omni_ros.environment import check_participant, chosen_domain

# Domains 0-101 are valid with the default port range of every operating system; 0 is the default.
_DOMAINS = range(1, 102)
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_BOUND_PORTS = (Path("/proc/net/udp"), Path("/proc/net/udp6"))


class NoFreeDomainError(InputError):
    """Another run uses the chosen ROS domain, or all domains of this machine are in use."""


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other run on this machine uses, until the ``with`` block ends.

    If the user has not chosen a domain, the reserved domain contains no other ROS program of this
    machine. A domain that the user has chosen may contain programs that only subscribe; the
    recorder rejects other publishers.

    Yields:
        Number of the domain; the value of ``ROS_DOMAIN_ID`` if the user has set it.

    Raises:
        ConfigurationError: ``ROS_DOMAIN_ID`` is not the number of a domain, discovery is off, or
            the static peers or the folder for the logs cannot be used.
        NoFreeDomainError: another run uses the chosen domain, or all domains are in use by runs or
            other ROS programs.
    """
    chosen = chosen_domain(os.environ)
    check_participant(os.environ)
    if os.environ.get(_RANGE) == "OFF":
        problem = "with OFF the nodes of a run cannot find each other: unset it, or set LOCALHOST"
        raise ConfigurationError(_RANGE, problem)
    if chosen is None:
        # Each process starts its search at a different domain, so two runs rarely try the same one.
        first = os.getpid() % len(_DOMAINS)
        candidates = [*_DOMAINS[first:], *_DOMAINS[:first]]
    else:
        candidates = [chosen]
    used = _used_domains() if chosen is None else frozenset()
    for number in candidates:
        if number in used:
            continue
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as mark:
            if _take(mark, number):
                yield number
                return
    if chosen is not None:
        raise NoFreeDomainError(
            f"ROS domain {chosen} is in use by another run, whose topics would mix with this "
            "one's; wait for its end, or leave ROS_DOMAIN_ID unset to be given a free one"
        )
    raise NoFreeDomainError(
        f"all {len(_DOMAINS)} ROS domains are taken by other runs and ROS programs; end some of "
        "them, or choose one with ROS_DOMAIN_ID"
    )


def _used_domains() -> frozenset[int]:
    """Return the domains in which a ROS program of this machine receives messages."""
    ports: set[int] = set()
    for path in _BOUND_PORTS:
        with contextlib.suppress(OSError):  # this file does not exist without IPv6
            lines = path.read_text().splitlines()[1:]
            ports |= {int(line.split()[1].rpartition(":")[2], 16) for line in lines}
    return frozenset(number for number in _DOMAINS if _is_inhabited(ports, number))


def _is_inhabited(ports: set[int], number: int) -> bool:
    # A participant binds the first of the 250 UDP ports of a domain, and one pair of ports from the
    # eleventh on for itself (RTPS 2.2, 9.6.1.1).
    first = 7400 + 250 * number
    pairs = range(first + 10, first + 250, 2)
    # A program without ROS may use a single port of the range.
    return first in ports or any({port, port + 1} <= ports for port in pairs)


def _take(mark: socket.socket, number: int) -> bool:
    """Mark a domain as used until the socket closes; return False if it is already in use.

    The mark is the name of the socket in Linux's abstract namespace. Unlike a lock file, the name
    has no owner who could lock out other users, and it disappears when the process ends. Processes
    see the name if they are in the same network namespace, in which they also share the domains.
    """
    try:
        mark.bind(f"\0omni-ros-domain-{number}")
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return False
        raise
    return True
