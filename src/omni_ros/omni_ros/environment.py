"""Environment of a node process, and its reports to the process that started it.

Importing this module does not require ROS.
"""

import contextlib
import json
import os
import re
import socket
import tempfile
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Any

from omni_core.configuration import ConfigurationError
from omni_core.files import user_folder

# ID of the process whose end also ends the node; set by the process that starts a graph.
PARENT_PID_VARIABLE = "OMNI_PARENT_PID"
# File descriptor to which a node writes its reports; set by the process that reads them.
REPORT_VARIABLE = "OMNI_REPORT_FD"

_DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
_PEERS_VARIABLE = "ROS_STATIC_PEERS"
_THREADS_VARIABLE = "NUMBA_NUM_THREADS"
_LARGEST_DOMAIN = 232  # higher domains would require UDP ports above 65535

_PROFILE = Path(__file__).with_name("fastdds_profile.xml")


def chosen_domain(environment: Mapping[str, str]) -> int | None:
    """Return the ROS domain that the user has chosen; None if none is chosen.

    Args:
        environment: environment variables; an empty ROS_DOMAIN_ID counts as unset, as in ROS.

    Raises:
        ConfigurationError: ROS_DOMAIN_ID is not the number of a domain.
    """
    text = environment.get(_DOMAIN_VARIABLE, "")
    if not text:
        return None
    # Leading zeros are rejected, because ROS reads such a number as octal.
    if not re.fullmatch(r"0|[1-9][0-9]{0,2}", text) or int(text) > _LARGEST_DOMAIN:
        raise ConfigurationError(
            _DOMAIN_VARIABLE, f"{text!r} is not a whole number from 0 to {_LARGEST_DOMAIN}"
        )
    return int(text)


def check_threads(environment: Mapping[str, str]) -> None:
    """Check the number of threads for numba, whose import would fail.

    Raises:
        ConfigurationError: NUMBA_NUM_THREADS is not the number of threads.
    """
    text = environment.get(_THREADS_VARIABLE, "")
    if text and not re.fullmatch("0*[1-9][0-9]*", text):
        raise ConfigurationError(
            _THREADS_VARIABLE, f"{text!r} is not a whole number above 0; unset it"
        )


def check_participant(environment: Mapping[str, str]) -> None:
    """Check the variables with which ROS could not start a node, and would not name them.

    Raises:
        ConfigurationError: a host of ROS_STATIC_PEERS is unknown, or the folder for the logs that
            the user has named cannot be written.
    """
    for peer in filter(None, environment.get(_PEERS_VARIABLE, "").split(";")):
        try:
            socket.getaddrinfo(peer, None)
        except (OSError, UnicodeError):
            problem = f"no host is named {peer!r}; give names or addresses, separated by ;"
            raise ConfigurationError(_PEERS_VARIABLE, problem) from None
    found = named_log_folder(environment)
    if found is None:
        return
    named, folder = found
    try:
        folder = folder.expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError) as error:  # RuntimeError: the home folder is unknown
        reason = getattr(error, "strerror", None) or error
        problem = f"cannot write logs to {folder}: {reason}; name another folder, or unset it"
        raise ConfigurationError(named, problem) from None


def named_log_folder(environment: Mapping[str, str]) -> tuple[str, Path] | None:
    """Return the variable that names a folder for the logs of ROS, and this folder.

    The result is None if no variable names a folder.
    """
    named = next(filter(environment.get, ("ROS_LOG_DIR", "ROS_HOME")), None)
    if named is None:
        return None
    return named, Path(environment[named], "" if named == "ROS_LOG_DIR" else "log")


def name_log_folder(environment: MutableMapping[str, str]) -> None:
    """Make ROS write its logs to a folder that the user can write.

    Without a folder for the logs, ROS would end the process. A folder that the user has named with
    ROS_LOG_DIR or ROS_HOME is not changed.

    Args:
        environment: environment variables, changed in place.
    """
    if named_log_folder(environment):
        return
    home = environment.get("HOME")
    wanted = [Path(home, ".ros", "log")] if home else []
    environment["ROS_LOG_DIR"] = str(user_folder("ros_log", *wanted))


def node_environment(domain: int) -> dict[str, str]:
    """Return the environment variables of this process, extended for nodes of a local graph.

    Variables by which the user has set a discovery range or a DDS profile keep their values.

    Args:
        domain: ROS domain of the graph.
    """
    environment = dict(os.environ)
    environment[_DOMAIN_VARIABLE] = str(domain)
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    environment.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(_PROFILE))
    environment.setdefault("PYTHONUNBUFFERED", "1")
    return environment


def report(document: Mapping[str, Any]) -> None:
    """Write a document to the file descriptor that an environment variable names.

    Standard output is not used, because the DDS implementation prints its errors there.

    Args:
        document: values that strict JSON can represent, written as one line.
    """
    descriptor = os.environ.get(REPORT_VARIABLE)
    line = json.dumps(document, allow_nan=False).encode() + b"\n"
    if descriptor is not None:
        with contextlib.suppress(OSError):  # the reading process has ended
            os.write(int(descriptor), line)
