"""What the supervisor says reaches who listens, and who comes a little later."""

import itertools
import time
from contextlib import ExitStack

import pytest
import zmq

from robotctl.app.supervision.announcer import Announcer
from robotctl.messages.control import Notice, Severity
from robotctl.runtime.ipc.topics import Endpoints, Subscriber, endpoint_directory

SECOND_NS = 1_000_000_000


@pytest.fixture
def listen():
    with ExitStack() as afterwards:
        context = zmq.Context()
        afterwards.callback(context.destroy, linger=0)

        def make():
            address = Endpoints(endpoint_directory("robot")).supervisor_notices
            ear = Subscriber[Notice](context, (address,), Notice)
            afterwards.callback(ear.close)
            return ear

        yield make


@pytest.fixture
def announcer(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    made = Announcer("robot")
    yield made
    made.close()


def heard(announcer, ear, now_ns, count=1):
    notices = []
    deadline_s = time.monotonic() + 10
    while len(notices) < count and time.monotonic() < deadline_s:
        announcer.step(now_ns)
        notices += ear.receive()
        time.sleep(0.005)
    return notices


def test_words_of_before_it_may_speak_and_of_later_are_both_heard(announcer, listen):
    announcer.say("control ended", Severity.CRITICAL, 1)
    announcer.say("telemetry ended", Severity.WARNING, 2)
    announcer.open()
    ear = listen()
    assert heard(announcer, ear, 3) == [
        Notice(2, Severity.CRITICAL, "control ended\ntelemetry ended")
    ]
    announcer.say("ready", Severity.INFORMATION, 4)
    assert heard(announcer, ear, 4) == [Notice(4, Severity.INFORMATION, "ready")]


def test_who_comes_much_later_hears_nothing_old(announcer, listen):
    announcer.open()
    announcer.say("control ended", Severity.CRITICAL, SECOND_NS)
    announcer.step(12 * SECOND_NS)
    ear = listen()
    for number in itertools.count():  # until it is connected
        announcer.say(f"word {number}", Severity.WARNING, 13 * SECOND_NS)
        if found := ear.receive():
            assert "control ended" not in "".join(each.text for each in found)
            return
        time.sleep(0.005)


def test_a_second_supervisor_that_may_not_speak_takes_nobodys_place(announcer, listen):
    announcer.open()
    ear = listen()
    second = Announcer("robot")
    second.say("the control process did not start", Severity.CRITICAL, 1)
    second.step(1)
    second.close()
    announcer.say("ready", Severity.INFORMATION, 2)
    assert heard(announcer, ear, 2)[0].text == "ready"
