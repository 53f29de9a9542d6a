"""A requested value reaches its service, however late the service starts and whatever is lost."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

from omni_tools.drive.confirmed_call import ConfirmedCall


class Service:
    """Service of a switch, whose replies are sent by the test."""

    def __init__(self) -> None:
        self.ready = True
        self.calls: list[tuple[Any, Future[Any]]] = []

    def service_is_ready(self) -> bool:
        return self.ready

    def call_async(self, request: Any) -> Future[Any]:
        self.calls.append((request, Future()))
        return self.calls[-1][1]

    def reply(self, number: int, *, success: bool = True) -> None:
        self.calls[number][1].set_result(SimpleNamespace(success=success))


def switch(service: Service) -> tuple[ConfirmedCall, list[bool]]:
    confirmed: list[bool] = []
    call = ConfirmedCall(
        service, lambda value: value, lambda reply: reply.success, confirmed.append
    )
    return call, confirmed


def test_a_request_before_the_service_starts_is_made_when_it_has_started() -> None:
    service = Service()
    service.ready = False
    call, confirmed = switch(service)
    call.wanted = False
    call.advance(0.0)
    assert not service.calls
    service.ready = True
    call.advance(5.0)
    assert (call.wanted,) == (False,)  # pending
    service.reply(0)
    assert (confirmed, call.wanted) == ([False], None)
    call.advance(6.0)
    assert len(service.calls) == 1


def test_a_lost_or_refused_call_is_repeated_but_not_while_its_reply_is_awaited() -> None:
    service = Service()
    call, confirmed = switch(service)
    call.wanted = True
    call.advance(0.0)
    call.advance(1.0)
    assert len(service.calls) == 1
    call.advance(10.0)
    assert len(service.calls) == 2
    service.reply(1, success=False)
    assert (confirmed, call.wanted) == ([], True)
    call.advance(20.0)
    service.reply(2)
    assert (confirmed, call.wanted) == ([True], None)


def test_a_value_requested_during_a_call_is_requested_next() -> None:
    service = Service()
    call, confirmed = switch(service)
    call.wanted = False
    call.advance(0.0)
    call.wanted = True
    service.reply(0)
    assert (confirmed, call.wanted) == ([False], True)
    call.advance(0.02)
    service.reply(1)
    assert (confirmed, call.wanted) == ([False, True], None)
