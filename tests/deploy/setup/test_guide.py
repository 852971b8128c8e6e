"""The guide: what it keeps, repeats, undoes and refuses; a person who leaves or interrupts."""

import json

import pytest

from robotctl.config.file_edit import Change
from robotctl.deploy.setup.bench import Bench, _Motion
from robotctl.deploy.setup.dialogue import Ask, Kind, PersonLeftError, Topic, UnfinishedError
from robotctl.deploy.setup.guide import Guide
from robotctl.deploy.setup.registry import Step
from robotctl.deploy.setup.steps.asking import on_blocks
from robotctl.errors import ConfigError
from tests.deploy.setup.setup_rig import STEP, SetupRig

SWAPPED = {"drive": {"axes": [{"actuator": "right"}, {"actuator": "left", "axis": 2}]}}


@pytest.fixture
def rig(tmp_path):
    return SetupRig(tmp_path, "diff_drive")


def changing(*changes, error=""):
    def run(bench):
        yield from on_blocks()
        if error:
            raise UnfinishedError(error, changes)
        return changes

    return Step("nodes", "a step that changes", run)


def test_what_is_done_is_known_the_next_time(rig):
    assert rig.run("nodes") == [True]
    again = Guide(rig.file, rig.buses, rig.person)
    assert again.done == {"nodes"}
    rig.person.script[Topic.NEXT] = ["stop"]
    assert not again.walk()
    assert rig.heard("1. drives and sensor nodes: done before")
    assert again.done == {"nodes", "counts"}


def test_a_step_is_undone_to_the_byte_and_has_to_be_done_again(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive", SWAPPED)
    assert rig.run("directions") == [True]
    assert "[[motor]]" in rig.text
    rig.guide.undo(STEP["directions"])
    assert rig.text == rig.before
    assert rig.guide.done == frozenset()
    assert rig.run("directions") == [True]
    assert "[[motor]]" in rig.text


def test_a_change_that_the_file_cannot_have_is_not_written(rig):
    assert not rig.guide.run(changing(Change(("limits", "v_max_m_s"), -1.0)))
    assert rig.heard("not written, as the file would be wrong")
    assert rig.heard("limits.v_max_m_s")
    assert rig.text == rig.before
    assert rig.guide.done == frozenset()


def test_what_an_unfinished_step_found_is_kept_but_the_step_is_not_done(rig):
    step = changing(Change(("limits", "v_max_m_s"), 0.7), error="half done")
    assert not rig.guide.run(step)
    assert rig.config.limits.v_max_m_s == 0.7
    assert rig.guide.done == frozenset()
    rig.guide.undo(step)
    assert rig.text == rig.before


def test_a_step_that_never_comes_to_rest_is_not_done(rig):
    def run(bench):
        yield from on_blocks()
        now = bench.config.limits.v_max_m_s
        return (Change(("limits", "v_max_m_s"), 0.6 if now == 0.7 else 0.7),)

    assert not rig.guide.run(Step("nodes", "restless", run, repeats=True))
    assert rig.heard("still not right")


def test_a_damaged_record_is_refused_with_its_name(rig):
    record = rig.file.with_suffix(".setup.json")
    record.write_text("{")
    with pytest.raises(ConfigError, match=r"robot.setup.json: cannot be read"):
        Guide(rig.file, rig.buses, rig.person)
    record.write_text(json.dumps({"done": ["nodes"]}))
    assert Guide(rig.file, rig.buses, rig.person).done == {"nodes"}


def test_an_answer_that_is_not_allowed_is_asked_for_again(rig):
    rig.person.script[Topic.WHEEL] = ["the left one", "le"]
    assert rig.run("directions") == [True]
    assert rig.heard("'the left one' found, please answer left, right, none")


def test_who_leaves_leaves_motors_off(rig):
    class Leaves(type(rig.person)):
        def answer(self):
            if self._question.topic is Topic.WHEEL:
                raise PersonLeftError("gone")
            return super().answer()

    guide = Guide(rig.file, rig.buses, Leaves(rig.simulation))
    with pytest.raises(PersonLeftError):
        guide.run(STEP["directions"])
    rig.buses.clock.sleep_until(rig.simulation.now_ns + 1_000_000_000)
    assert not rig.simulation.plant.powered
    assert rig.text == rig.before


def test_a_key_stops_a_motion_within_a_tick(rig):
    begun = []

    def presses():
        begun.append(rig.simulation.plant.axes[0].angle_rad)
        return abs(begun[-1] - begun[0]) > 0.1

    with Bench(rig.config, rig.buses, presses) as bench:
        bench.commission()
        moved = bench.keep_spinning(bench.wheels[:1])
        assert moved.stopped == "you stopped it"
        bench.rest()
        assert not rig.simulation.plant.powered
    assert 0.1 < begun[-1] - begun[0] < 0.2


def test_a_key_on_ctrl_c_ends_with_the_motors_off(rig):
    def interrupts():
        if rig.simulation.plant.axes[0].speed_rad_s > 0.5:
            raise KeyboardInterrupt
        return False

    def spin():
        with Bench(rig.config, rig.buses, interrupts) as bench:
            bench.commission()
            bench.keep_spinning(bench.wheels)

    with pytest.raises(KeyboardInterrupt):
        spin()
    now_ns = rig.simulation.now_ns
    rig.buses.clock.sleep_until(now_ns + 20_000_000)  # less than the drive's own time-out
    assert not rig.simulation.plant.powered


def test_between_question_and_answer_the_motors_are_off(rig):
    powered = []

    class Looks(type(rig.person)):
        def answer(self):
            powered.append(self._simulation.plant.powered)
            return super().answer()

    assert Guide(rig.file, rig.buses, Looks(rig.simulation)).run(STEP["directions"])
    assert len(powered) > 4
    assert not any(powered)


@pytest.mark.parametrize(
    ("ask", "text", "answer"),
    [
        (Ask(Topic.NEXT, "?", Kind.CHOICE, ("go on", "again"), "go on"), "", "go on"),
        (Ask(Topic.NEXT, "?", Kind.CHOICE, ("go on", "again"), "go on"), "a", "again"),
        (Ask(Topic.NEXT, "?", Kind.YES_NO), "Y", "yes"),
        (Ask(Topic.SPEED, "?", Kind.NUMBER, default="0.8"), "", 0.8),
        (Ask(Topic.SPEED, "?", Kind.NUMBER), " 1.5 ", 1.5),
        (Ask(Topic.BLOCKS, "?"), "whatever", "done"),
    ],
)
def test_answers_are_read(ask, text, answer):
    assert ask.read(text) == answer


@pytest.mark.parametrize(
    "ask",
    [
        Ask(Topic.SPEED, "?", Kind.NUMBER),
        Ask(Topic.NEXT, "?", Kind.CHOICE, ("left", "left_rear"), ""),
        Ask(Topic.NEXT, "?", Kind.YES_NO),
    ],
)
def test_answers_that_say_nothing_are_refused(ask):
    for text in ("", "x", "l"):
        with pytest.raises(ValueError, match=r"no number|please answer"):
            ask.read(text)


def test_no_duty_turns_a_free_wheel_fast_even_if_nothing_reports_it(rig):
    with Bench(rig.config, rig.buses) as bench:
        bench.commission()
        motion = _Motion(bench, bench.wheels[:1])
        duties = [motion.command(0.005).values[0] for _ in range(4000)]
        supply_v = bench.feedback.actuators[0].voltage_v
    motor = rig.config.plausibility
    duty = max(duties) - rig.config.control.pwm.deadband
    free_m_s = duty * supply_v / motor.back_emf_v_s_rad * rig.config.drive.wheel_radius_m
    assert free_m_s == pytest.approx(0.2)
