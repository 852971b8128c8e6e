"""Bring-up, last step: a browser drives the robot and stops it, and what becomes of it may fail."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator

import pytest

from hil_tests.browser import Page
from hil_tests.bus_tool import EMERGENCY_STOP
from hil_tests.faulty_navigation import LEAK
from hil_tests.rig import PATIENT_S, Rig
from robotctl.app.supervision.stack import NAVIGATION, WEB
from robotctl.messages.control import Mode, SafetyState
from robotctl.web.links import read_links

React = Callable[[str, float], None]

FORWARD, TURN = 0.5, 0.32
"""Sticks for a circle of half a metre."""
LET_GO_MS = 500.0
"""From the last sample of the sticks to a set-point that goes down to rest."""
STOP_MS = 100.0
STATE_MS = 20.0


@pytest.fixture
def rig(make_rig: Callable[..., Rig], without_floods: None) -> Rig:
    """Firmware, control, navigation and the web page, armed."""
    rig = make_rig(override="web={enabled=true,port=0}")
    rig.start_firmware()
    rig.start()
    rig.start(NAVIGATION)
    rig.start(WEB, "hil_tests.faulty_web")
    rig.arm()
    rig.wait(lambda: rig.navigation, PATIENT_S, "navigation works")
    rig.prefer(NAVIGATION, WEB)
    return rig


def url_of(rig: Rig) -> str:
    """Return where the page is, once it is."""
    rig.wait(lambda: read_links(rig.endpoints.web_links), PATIENT_S, "the page is served")
    return read_links(rig.endpoints.web_links).address


@pytest.fixture
def page(rig: Rig) -> Iterator[Page]:
    with Page(url_of(rig)) as page:
        yield page


def drive_off(rig: Rig, page: Page) -> None:
    """Become the driver, hold the key, and wait until the robot drives."""
    page.release()
    rig.wait(lambda: "Hello" in page.seen, PATIENT_S, "the page is greeted")
    page.send("TakeDriving", id=1, at_ms=page.at_ms)
    me = page.seen["Hello"]["client"]
    rig.wait(lambda: page.seen["Driver"]["client"] == me, PATIENT_S, "it is the driver")
    rig.heard(0.2)
    page.hold(FORWARD, TURN)
    rig.wait(lambda: rig.control.v_m_s > 0.3, PATIENT_S, "the robot drives")
    assert rig.navigation.mode == Mode.MANUAL


def ramp_ms(rig: Rig) -> float:
    """Return the time that the limiter takes from the driven speed to rest."""
    limits = rig.config.limits
    v_m_s = FORWARD * limits.v_max_m_s
    return 1e3 * (v_m_s / limits.a_max_m_s2 + 2 * limits.a_max_m_s2 / limits.jerk_max_m_s3)


def comes_to_rest(rig: Rig, since_ns: int, what: str, reaction: React) -> None:
    """Assert that the robot is at rest in time after the last sample of the sticks."""
    rig.wait(lambda: rig.control.v_ref_m_s == 0.0, 3.0, "it comes to rest")
    taken_ms = (rig.control.stamp_ns - since_ns) / 1e6
    reaction(f"web page, {what}: at rest", taken_ms)
    assert taken_ms <= LET_GO_MS + ramp_ms(rig) + 2 * STATE_MS
    rig.at_rest()
    assert rig.control.state == SafetyState.ARMED
    assert rig.navigation.mode == Mode.MANUAL


def use_up_memory(rig: Rig, _page: Page) -> None:
    """Let the server take all memory that it can have, and end."""
    rig.send_signal(WEB, LEAK)
    rig.wait(lambda: not rig.is_running(WEB), PATIENT_S, "its memory is used up")


ENDS: dict[str, Callable[[Rig, Page], None]] = {
    "key released": lambda _rig, page: page.release(),
    "pad stands still": lambda _rig, page: page.stand_still(),
    "network cut": lambda _rig, page: page.fall_silent(),
    "browser killed": lambda _rig, page: page.die(),
    "server killed": lambda rig, _page: rig.kill(WEB),
    "server out of memory": use_up_memory,
    "server frozen": lambda rig, _page: rig.send_signal(WEB, signal.SIGSTOP),
}


@pytest.mark.parametrize("end", ENDS)
def test_a_robot_driven_by_a_page_is_at_rest_soon_after_the_last_sample(
    rig: Rig, page: Page, end: str, reaction: React
) -> None:
    drive_off(rig, page)
    rig.at_any_moment()
    overruns = rig.control.loop.overruns
    ENDS[end](rig, page)
    since_ns = time.monotonic_ns() if end.startswith("server") else page.sample_ns
    comes_to_rest(rig, since_ns, end, reaction)
    before = rig.fresh_truth()
    if not rig.is_running(WEB):
        rig.endpoints.web_links.write_bytes(b"")  # as if it had not been served yet
        rig.start(WEB)
    if end == "server frozen":
        rig.send_signal(WEB, signal.SIGCONT)
    rig.heard(1.0)  # the sticks are held all the time, or what was queued arrives
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3
    rig.listen()
    assert time.monotonic_ns() - rig.control.stamp_ns < 100_000_000
    assert time.monotonic_ns() - rig.navigation.stamp_ns < 300_000_000
    assert rig.control.loop.overruns - overruns <= 5
    with Page(url_of(rig)) as again:
        drive_off(rig, again)


def test_a_stop_of_a_page_takes_the_power_off_the_wheels(
    rig: Rig, page: Page, reaction: React
) -> None:
    drive_off(rig, page)
    with Page(url_of(rig), "/stop") as stop:
        rig.heard(0.1)
        rig.at_any_moment()
        asked_ns, asked_s = time.monotonic_ns(), time.time()
        stop.send("Stop", id=8)
        heard_s = rig.heard_until(EMERGENCY_STOP, 1.0)[-1].timestamp
        reaction("web page, stop: on the bus", 1e3 * (heard_s - asked_s))
        rig.wait(lambda: rig.truth.power_off_ns > asked_ns, 2.0, "the wheels lose their power")
        taken_ms = (rig.truth.power_off_ns - asked_ns) / 1e6
        reaction("web page, stop: wheels without power", taken_ms)
        assert taken_ms < STOP_MS
        rig.wait(lambda: "StopSeen" in stop.seen, 1.0, "the page is answered")
        assert stop.seen["StopSeen"]["id"] == 8
        assert stop.seen["StopSeen"]["state"] == SafetyState.EMERGENCY_STOP
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    rig.at_rest()
    rig.arm()
    before = rig.fresh_truth()
    rig.heard(0.5)
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3, "the key is held all the time"


def test_arming_from_a_page_is_refused_in_control_s_words(rig: Rig, page: Page) -> None:
    rig.kill("firmware")
    rig.wait_for_state(SafetyState.FAULT)
    page.send("ArmRequest", id=1, at_ms=page.at_ms, arm=True)
    rig.wait(lambda: page.refused, PATIENT_S, "it is refused")
    assert page.refused[0] not in ("", "refused", "control does not answer")
