"""A campaign gives the same runs for any number of workers and parts, and loses none."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest
from local_cluster import local_client

from omni_core.configuration import ConfigurationError
from omni_tools.campaign import runner
from omni_tools.campaign.runner import CampaignError, CampaignOptions, distribute, run_campaign

if TYPE_CHECKING:
    from distributed import Client


class Row(NamedTuple):
    seed: int
    root: float
    words: str


def work(seed: int) -> Row:
    return Row(seed, seed**0.5, "odd" if seed % 2 else "")


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with local_client() as client:
        yield client


def campaign(folder: Path, runs: int = 40, **options: object) -> list[Row]:
    folder.mkdir(exist_ok=True)
    chosen = CampaignOptions(**options)  # type: ignore[arg-type]
    return run_campaign(work, range(5, 5 + runs), Row, chosen, folder / "runs.csv", "abc")


def test_pieces_put_together_are_the_whole(tmp_path: Path, client: Client) -> None:
    whole = campaign(tmp_path / "whole", workers=1)
    assert whole == [work(seed) for seed in range(5, 45)]
    first = campaign(tmp_path / "first", workers=1, seeds="0:20")
    second = campaign(tmp_path / "second", scheduler=client.scheduler.address, seeds="20:99")
    assert [row.seed for row in (*first, *second)] == list(range(5, 45))
    parts = (tmp_path / "first", tmp_path / "second")
    merged = campaign(tmp_path / "merged", workers=1, merge=parts)
    assert merged == whole
    tables = {(tmp_path / name / "runs.csv").read_text() for name in ("whole", "merged")}
    assert len(tables) == 1


def test_a_cluster_runs_every_seed_once_in_chunks_sized_by_time(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    for duration, largest in ((1e-9, 100), (10.0, 2)):
        monkeypatch.setattr(runner, "timed", lambda w, d=duration: (w(), d))
        chunks: list[list[Row]] = []
        distribute(client, work, range(400), chunks.append)
        assert sorted(row.seed for chunk in chunks for row in chunk) == list(range(400))
        assert max(map(len, chunks)) <= largest
        assert (max(map(len, chunks)) > 20) == (duration < 1.0)
        assert sum(len(chunk) == 1 for chunk in chunks) < 300 or duration > 1.0


def test_what_is_not_of_the_campaign_is_refused(tmp_path: Path) -> None:
    campaign(tmp_path, runs=3, workers=1)
    with pytest.raises(ConfigurationError, match=r"--seeds: 90:99 contains none"):
        campaign(tmp_path, workers=1, seeds="90:99")
    with pytest.raises(ConfigurationError, match="--merge: there is no"):
        campaign(tmp_path, workers=1, merge=(tmp_path / "nowhere",))
    text = (tmp_path / "runs.csv").read_text()
    (tmp_path / "runs.csv").write_text(text.replace("abc", "def"))
    with pytest.raises(ConfigurationError, match="--resume"):
        campaign(tmp_path, workers=1, resume=True)
    for wrong in ({"seeds": "5"}, {"workers": 2, "scheduler": "tcp://x"}, {"workers": 0}):
        with pytest.raises(ConfigurationError):
            CampaignOptions(**wrong)


def test_a_campaign_goes_on_where_it_ended(tmp_path: Path) -> None:
    campaign(tmp_path, runs=10, workers=1)
    path = tmp_path / "runs.csv"
    # Existing results are not computed again, even if they are wrong.
    path.write_text(path.read_text().replace("6,2.449489742783178,", "6,0.5,")[:-3])
    rows = campaign(tmp_path, runs=12, workers=1, resume=True)
    assert rows[1] == Row(6, 0.5, "")
    assert rows[2:] == [work(seed) for seed in range(7, 17)]


def test_work_that_kills_or_fails_ends_the_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "_WORTH", 0.0)
    options = CampaignOptions(workers=2)
    parent = os.getpid()

    def deadly(seed: int) -> Row:
        if os.getpid() != parent and seed == 20:
            os.kill(os.getpid(), signal.SIGKILL)
        return work(seed)

    def dying(seed: int) -> Row:
        if os.getpid() != parent and seed == 20 and not (tmp_path / "died").exists():
            (tmp_path / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return work(seed)

    def failing(seed: int) -> Row:
        if seed == 20:
            raise ValueError("twenty")
        return work(seed)

    path = tmp_path / "runs.csv"
    assert len(run_campaign(dying, range(40), Row, options, path, "abc")) == 40
    with pytest.raises(CampaignError, match="several workers died with the seeds"):
        run_campaign(deadly, range(40), Row, options, path, "abc")
    with pytest.raises(ValueError, match="twenty"):
        run_campaign(failing, range(40), Row, options, path, "abc")
    assert not multiprocessing.active_children()


ORPHANS = """
import os, sys, time
from omni_tools.campaign.processes import share

def run(seeds):
    os.write(1, b"%d\\n" % os.getpid())  # a line in one piece: both write to one pipe
    return seeds

share(run, lambda: [0], 2, lambda _: time.sleep(0.05))
"""


def test_workers_end_with_the_process_that_started_them() -> None:
    starter = subprocess.Popen([sys.executable, "-c", ORPHANS], stdout=subprocess.PIPE, text=True)
    assert starter.stdout is not None
    workers: set[int] = set()
    while len(workers) < 2:
        workers.add(int(starter.stdout.readline()))
    starter.kill()
    # The output ends when the last worker ends; the timeout only ends a test that hangs.
    starter.communicate(timeout=60.0)
