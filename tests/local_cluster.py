"""A cluster of one worker in this process, to which campaigns send their runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distributed import Client


@contextmanager
def local_client() -> Iterator[Client]:
    """Yield the client of a cluster."""
    from distributed import Client, LocalCluster  # slow import, for one process of all tests only

    with (
        LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client
