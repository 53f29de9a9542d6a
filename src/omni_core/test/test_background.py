"""Work in a background thread."""

import threading
from collections.abc import Callable, Iterator

import pytest

from omni_core import background


@pytest.fixture(params=["1", ""], ids=["one thread", "two threads"])
def begin(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Callable[[], int]], Callable[[], int]]]:
    monkeypatch.setenv(background.ALONE, request.param)
    background._thread.cache_clear()
    yield background.in_background
    background._thread.cache_clear()


Begin = Callable[[Callable[[], int]], Callable[[], int]]


def test_each_work_hands_over_its_own_result_and_is_done_once(begin: Begin) -> None:
    done: list[int] = []

    def work(number: int) -> int:
        done.append(number)
        return number * number

    results = [begin(lambda number=number: work(number)) for number in range(200)]  # type: ignore[misc]
    assert [result() for result in reversed(results)] == [n * n for n in reversed(range(200))]
    assert sorted(done) == list(range(200))


def test_an_error_is_raised_where_the_result_is_requested_and_nowhere_else(begin: Begin) -> None:
    def fail() -> int:
        raise ValueError("no ground")

    failing, sound = begin(fail), begin(lambda: 7)
    assert sound() == 7
    with pytest.raises(ValueError, match="no ground"):
        failing()


def test_who_needs_a_result_does_the_work_that_has_not_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(background.ALONE, raising=False)
    monkeypatch.setattr("os.sched_getaffinity", lambda _pid: {0, 1})
    background._thread.cache_clear()
    begun, let_go = threading.Event(), threading.Event()

    def held() -> str:
        begun.set()
        let_go.wait()
        return threading.current_thread().name

    first = background.in_background(held)
    begun.wait()
    second = background.in_background(lambda: threading.current_thread().name)
    assert second() == threading.current_thread().name
    let_go.set()
    assert first().startswith("background")
    background._thread.cache_clear()


def test_what_is_not_worth_it_stays_here() -> None:
    work = background.in_background(threading.current_thread, worth=False)
    assert work() is threading.current_thread()
