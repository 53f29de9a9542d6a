"""Calls in a fork of the server of nodes."""

import os
import re
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from omni_core.configuration import ConfigurationError, WorkError
from omni_recording.error import BagError
from omni_runs.graph.fork_server import Worker


@pytest.fixture
def worker() -> Iterator[Worker]:
    with closing(Worker()) as created:
        yield created


def refuse(error: Exception) -> None:
    raise error


def test_results_can_be_awaited_in_any_order_and_again(worker: Worker) -> None:
    product, process = worker.begin(partial(pow, 2, 10)), worker.begin(os.getpid)
    assert process() != os.getpid()
    assert product() == product() == 1024


@pytest.mark.parametrize(
    "error",
    [
        BagError(Path("bag"), "is empty"),
        ConfigurationError("vehicle.load", "is too heavy"),
        WorkError("the disk is full"),
        PermissionError(13, "no access", "bag"),
    ],
)
def test_an_error_of_a_call_is_raised_and_the_next_call_works(
    worker: Worker, error: Exception
) -> None:
    failed, after = worker.begin(partial(refuse, error)), worker.begin(partial(pow, 3, 2))
    with pytest.raises(type(error), match=re.escape(str(error))):
        failed()
    assert after() == 9


def test_the_end_of_the_process_is_noticed(worker: Worker) -> None:
    result = worker.begin(partial(os._exit, 1))
    with pytest.raises(WorkError, match="ended"):
        result()
    with pytest.raises(WorkError, match="ended"):
        worker.begin(os.getpid)()


def test_the_process_ends_after_close() -> None:
    worker = Worker()
    process = worker.begin(os.getpid)()
    worker.close()
    deadline = time.monotonic() + 10.0
    while Path(f"/proc/{process}").exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
