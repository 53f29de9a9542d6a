"""Driving with keys in a browser: two stops, and the report."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import Chromium, browser_program, chromium
from omni_process import drive_process, omni_here

PATIENCE = 60.0  # [s] only ends a test that hangs
# Without pictures, so that a busy machine keeps up with the wall clock.
CARDS = "document.querySelectorAll('#stops li').length"


@pytest.fixture(autouse=True)
def _skipped_without_a_browser() -> None:
    """Look for a browser before a drive is started."""
    browser_program()


def hold(browser: Chromium, code: str, *, down: bool) -> None:
    kind = "rawKeyDown" if down else "keyUp"
    browser.call("Input.dispatchKeyEvent", type=kind, code=code)


def press(browser: Chromium, code: str) -> None:
    hold(browser, code, down=True)
    hold(browser, code, down=False)


def stop_from(browser: Chromium, speed: float, number: int) -> str:
    """Drive ahead up to a speed [m/s], brake to rest, and return the card of this stop."""
    hold(browser, "Space", down=False)
    hold(browser, "KeyW", down=True)
    browser.wait(f"Number(document.getElementById('speed').textContent) > {speed}")
    hold(browser, "KeyW", down=False)
    hold(browser, "Space", down=True)
    browser.wait(f"{CARDS} === {number}")
    return str(browser.run("document.querySelector('#stops li').textContent"))


def assisted_stops(browser: Chromium, speed: float) -> list[str]:
    """Stop from a speed [m/s] until a stop is assisted; return the cards of all stops.

    On a busy machine, enables are late, and late enables mean all brakes on.
    """
    cards: list[str] = []
    while not cards or "unassisted" in cards[-1]:
        assert len(cards) < 5, cards
        cards.append(stop_from(browser, speed, len(cards) + 1))
    return cards


@contextlib.contextmanager
def page_of(process: subprocess.Popen[str], width: int) -> Iterator[Chromium]:
    """Show the page of a drive in a window of a given width [px] once the vehicle responds."""
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    with chromium() as browser:
        browser.show(width, 800)
        browser.call("Page.navigate", url=url)
        browser.wait("document.getElementById('banner')?.hidden === false")
        yield browser


def test_a_drive_with_keys_shows_its_stops_and_so_does_its_report(tmp_path: Path) -> None:
    recording = tmp_path / "drive"
    with drive_process(recording) as process, page_of(process, 1280) as browser:
        assert browser.run(
            "[...document.querySelectorAll('#choices select')].every(e => e.disabled)"
        )
        assert "--out" in browser.run("$('remark').textContent")
        cards = assisted_stops(browser, 1.5)
        assert browser.run("document.getElementById('ice-legend').hidden") is False
        press(browser, "KeyB")  # the assistant is switched off
        browser.wait("document.getElementById('banner').textContent.includes('OFF')")
        cards.append(stop_from(browser, 1.5, len(cards) + 1))
        assert browser.complaints == []
    assert f"Stop {len(cards)}: unassisted" in cards[-1]

    finished = omni_here(["compare", str(recording), "--json"])
    assert finished.returncode == 0, finished.stderr
    metrics = json.loads(finished.stdout)["metrics"]
    assert metrics["stops.drive"]["value"] == len(cards)
    for number, card in enumerate(cards, 1):
        shown = re.search(r"([\d.]+) (c?)m, [\d.]+°", card)
        assert shown is not None, card
        distance = float(shown[1]) * (0.01 if shown[2] else 1.0)
        measured = metrics[f"stopping_distance.drive/stop_{number}"]["value"]
        # Both begin at the stamp of the pedal and end half a second after the first stamp at rest,
        # on the page up to a thirtieth of a second later.
        assert distance == pytest.approx(measured, abs=0.02)
    assert metrics[f"assisting_share.drive/stop_{len(cards)}"]["value"] == 0.0
    page = tmp_path / "report.html"
    finished = omni_here(["report", str(recording), "--out", str(page)])
    assert finished.returncode == 0, finished.stderr
    text = page.read_text()
    assert "drive/stop_2" in text
    assert "A drive: mecanum_forklift, cork, sliding_mode" in text
    assert "A short assisted stop" not in text


def touch(browser: Chromium, kind: str, *points: tuple[int, int]) -> None:
    touches = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
    browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=touches)


def drag(browser: Chromium, start: tuple[int, int], end: tuple[int, int], expression: str) -> None:
    """Hold a finger away from where it touched until an expression is true, then lift it.

    A window that loses the focus lets go of all fingers, and then its user touches again.
    """
    deadline = time.monotonic() + PATIENCE
    touch(browser, "touchStart", start)
    touch(browser, "touchMove", end)
    while not browser.run(expression):
        assert time.monotonic() < deadline, (expression, browser.run("[state, ...fingers]"))
        if browser.run("fingers.size === 0"):
            touch(browser, "touchEnd")
            touch(browser, "touchStart", start)
        touch(browser, "touchMove", end)
    touch(browser, "touchEnd")
    assert browser.run("fingers.size === 0")


def test_a_phone_moves_and_turns_by_touch() -> None:
    with drive_process() as process, page_of(process, 400) as browser:
        straight = "state.twist[0] > 0.5 && Math.abs(state.twist[2]) < 0.05"
        drag(browser, (80, 200), (80, 120), straight)
        drag(browser, (320, 200), (260, 200), "state.twist[2] > 0.3")


def choose(browser: Chromium, kind: str, name: str) -> None:
    browser.run(
        f"{{const list = document.getElementById('choose-{kind}'); list.value = '{name}';"
        " list.dispatchEvent(new Event('change'));}"
    )
    browser.wait(f"document.getElementById('choose-{kind}')?.value === '{name}' && !choosing")
    browser.wait("document.getElementById('banner').hidden === false && state?.pose")


def place_of(card: str) -> tuple[float, float]:
    """Return where the stop of a card began: x, y [m]."""
    found = re.search(r"at \((-?[\d.]+),\s(-?[\d.]+)\)\sm", card)
    assert found is not None, card
    return float(found[1]), float(found[2])


def test_a_reset_repeats_the_stop_at_its_place() -> None:
    with drive_process() as process, page_of(process, 400) as browser:
        first = stop_from(browser, 2.0, 1)
        rest = browser.run("state.pose[0]")
        assert rest > 0.5
        press(browser, "KeyR")
        browser.wait("resetting === null && state.pose[0] < 0.1")
        assert browser.run("Math.hypot(...state.twist)") < 0.05
        # The pedal is still pressed: the placed vehicle has not stopped once more.
        again = stop_from(browser, 2.0, 2)
        # A busy machine shows a speed later, and then the vehicle has driven farther.
        assert max(place_of(first)[0], place_of(again)[0]) < rest
        # A vehicle that is placed in the middle of a stop has not stopped there.
        hold(browser, "Space", down=False)
        hold(browser, "KeyW", down=True)
        browser.wait("state.twist[0] > 2.0")
        hold(browser, "KeyW", down=False)
        hold(browser, "Space", down=True)
        browser.click("#reset")
        browser.wait("resetting === null && state.pose[0] < 0.1")
        browser.wait("Number(document.getElementById('speed').textContent) < 0.1")  # drawn later
        stop_from(browser, 2.0, 3)
        assert browser.complaints == []


def test_the_switch_is_not_lost_while_the_page_is_not_connected() -> None:
    with drive_process() as process:
        assert process.stdout is not None
        url = process.stdout.readline().strip()
        with chromium() as browser:
            browser.show(400, 800)
            browser.call("Page.navigate", url=url)
            # As early as the script of the page is there; the assistant starts later.
            browser.wait("typeof toggle === 'function'")
            press(browser, "KeyB")
            browser.wait("state?.assist_state === 'disabled' && !$('assist').checked")
            browser.wait("$('pending').textContent === ''")
            browser.run("socket.close()")
            press(browser, "KeyB")
            browser.wait("$('pending').textContent === 'on: pending'")
            assert (
                browser.run("$('assist').checked") is False
            )  # confirmed is only what is confirmed
            browser.wait("$('assist').checked && $('pending').textContent === ''")
            press(browser, "KeyB")
            browser.wait("!$('assist').checked && $('pending').textContent === ''")
            choose(browser, "law", "allocation")
            browser.wait("state?.assist_state === 'disabled' && !$('assist').checked")


def brightness(color: str) -> float:
    """Return the mean of red, green and blue of ``rgb(...)``, 0..255."""
    return sum(map(int, re.findall(r"\d+", color)[:3])) / 3


def test_the_page_chooses_what_is_driven() -> None:
    with drive_process() as process:
        with page_of(process, 400) as browser:
            browser.wait("document.getElementById('choose-vehicle')?.value === 'mecanum_forklift'")
            choose(browser, "vehicle", "three_wheel_robot")
            assert browser.run("vehicle.wheels.length") == 3
            choose(browser, "law", "allocation")
            assert browser.run("vehicle.wheels.length") == 3  # what was chosen before stays
            assert "assisted by allocation" in assisted_stops(browser, 2.0)[-1]
            choose(browser, "brakes", "spring")
            stop_from(browser, 2.0, browser.run(CARDS) + 1)
            groups = "[...document.querySelectorAll('#stops h2')].map(e => e.textContent)"
            assert browser.run(groups) == [
                "three wheel robot on cork, brakes: spring",
                "three wheel robot on cork, brakes: on off",
            ]
            for dark in (False, True):
                browser.show(400, 800, dark=dark)
                assert browser.run("document.documentElement.scrollWidth") <= 400
                shown = "getComputedStyle(document.querySelector('#stops li'))"
                ink, paper = (browser.run(f"{shown}.{key}") for key in ("color", "backgroundColor"))
                assert (brightness(paper) < brightness(ink)) == dark
                assert abs(brightness(paper) - brightness(ink)) > 150
            # However many stops there are, each has its card, in a list that scrolls.
            browser.run(
                "for (let i = 0; i < 20; i++)"
                " group().append(group().firstElementChild.cloneNode(true))"
            )
            assert browser.run("$('stops').scrollHeight > $('stops').clientHeight")
            assert browser.run(
                "$('stops').getBoundingClientRect().bottom"
                " < $('legend').getBoundingClientRect().top"
            )
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=PATIENCE)
    assert out == ""  # one address, which stayed
