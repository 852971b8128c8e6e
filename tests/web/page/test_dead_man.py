"""Laws of the dead man's handle, over any course of events."""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.web.page.node_program import NodeProgram, node_program

pytestmark = pytest.mark.node

STEP_MS = 50
FROZEN_MS = 200
ANSWER = """
const reading = (device) => ({ turn: 0, sideways: 0, ...device });
function answer(line) {
  const deadMan = new part.DeadMan();
  return JSON.stringify(JSON.parse(line).map(({ interrupt, nowMs, devices }) => {
    if (interrupt) deadMan.interrupt("blur");
    const entries = Object.entries(devices).map(([name, each]) => [name, reading(each)]);
    return deadMan.step(new Map(entries), nowMs);
  }));
}
"""


@pytest.fixture(scope="module")
def dead_man(tmp_path_factory):
    with node_program("driving/dead_man.ts", ANSWER, tmp_path_factory.mktemp("node")) as program:
        yield program


@dataclass(frozen=True)
class Event:
    """One step: whether something interrupts, and per device: held, forward, a new sample."""

    interrupt: bool
    devices: tuple[tuple[bool, float, bool], ...]


NAMES = ("touch", "keyboard", "pad")
DEVICES = st.tuples(st.booleans(), st.sampled_from([0.0, 1.0, -0.5]), st.booleans())
EVENTS = st.lists(
    st.builds(Event, st.integers(0, 9).map(lambda n: n == 0), st.tuples(DEVICES, DEVICES, DEVICES)),
    max_size=40,
)


def steps_of(events: list[Event]) -> list[dict]:
    """Return the course in the program's words; a device without a new sample repeats its last."""
    sampled, steps = dict.fromkeys(NAMES, 0), []
    for number, event in enumerate(events, 1):
        devices = {}
        for name, (held, forward, is_new) in zip(NAMES, event.devices, strict=True):
            sampled[name] = number * STEP_MS if is_new else sampled[name]
            devices[name] = {"held": held, "forward": forward, "sampledMs": sampled[name]}
        steps.append({"interrupt": event.interrupt, "nowMs": number * STEP_MS, "devices": devices})
    return steps


def decided(program: NodeProgram, events: list[Event]) -> list[tuple[dict, dict]]:
    """Return each step with what was decided in it."""
    steps = steps_of(events)
    return list(zip(steps, program.ask(json.dumps(steps)), strict=True))


@given(EVENTS)
def test_what_drives_is_held_and_was_released_since_the_last_interruption(dead_man, events):
    released: set[str] = set()
    for step, decision in decided(dead_man, events):
        if step["interrupt"]:
            released.clear()
        released |= {name for name, device in step["devices"].items() if not device["held"]}
        if decision["held"]:
            device = step["devices"][decision["source"]]
            assert device["held"]
            assert decision["forward"] == device["forward"]
            assert decision["source"] in released
        else:
            assert decision["source"] is None
            assert decision["forward"] == 0


@given(EVENTS)
def test_nobody_takes_the_sticks_from_a_device_that_is_held(dead_man, events):
    before = None
    for step, decision in decided(dead_man, events):
        if before is not None and decision["held"] and not step["interrupt"]:
            was_held = step["devices"][before]["held"]
            assert decision["source"] == before or not was_held
        before = decision["source"]


@given(EVENTS)
def test_a_deflected_stick_that_is_followed_is_never_old(dead_man, events):
    for step, decision in decided(dead_man, events):
        if decision["held"]:
            assert step["nowMs"] - decision["takenMs"] <= FROZEN_MS
            if decision["forward"] != 0:
                assert decision["takenMs"] <= step["nowMs"]


@given(EVENTS)
def test_the_number_of_the_sample_grows_with_each_new_one_and_stands_still_with_it(
    dead_man, events
):
    before = None
    for _, decision in decided(dead_man, events):
        if before is not None:
            assert decision["sample"] >= before["sample"]
            is_same = decision["source"] is not None and decision["source"] == before["source"]
            if is_same and decision["takenMs"] == before["takenMs"]:
                assert decision["sample"] == before["sample"]
        before = decision


@pytest.mark.parametrize(("forward", "is_followed"), [(1.0, False), (0.0, True)])
def test_a_frozen_device_is_let_go_only_while_its_stick_is_deflected(
    dead_man, forward, is_followed
):
    idle, away = (False, 0.0, True), (False, 0.0, False)
    begin = Event(False, (idle, away, away))
    held = Event(False, ((True, forward, True), away, away))
    frozen = Event(False, ((True, forward, False), away, away))
    course = decided(dead_man, [begin, held, *[frozen] * 5, held])
    followed = [decision["held"] for _, decision in course]
    assert followed[1:6] == [True] * 5  # until 200 ms
    assert followed[6:] == [is_followed] * 2  # and a sample that comes again is no fresh edge
