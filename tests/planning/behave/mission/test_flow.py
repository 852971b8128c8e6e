"""Repeats, jumps and waiting for something: the order of items, and what is refused at once."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.errors import ConfigError, MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    AbortRequest,
    ExploreRequest,
    GoAheadRequest,
    JumpRequest,
    ModeRequest,
)
from robotctl.planning.behave.behaviours.flow import JumpItem, RepeatItem
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.behaviours.wait import WaitItem
from robotctl.planning.behave.behaviours.wait_for import WaitForItem
from robotctl.planning.behave.mission.flow import MissionFlow, flow_problems
from robotctl.planning.behave.mission.mission_file import Mission, StartPose, parse_mission
from robotctl.planning.navigation_step import LoadRequest

AUTO, HOLD = ModeRequest(Mode.AUTO), ModeRequest(Mode.HOLD)
HEAD = 'name = "m"\nworld = "flat"\nstart = { x_m = 1.0, y_m = 1.0 }\n'
BLINK = 0.04
"""A wait of one step [s]."""


def mission(*items):
    return Mission("test", StartPose(1.0, 1.0), items)


def there(x, y=1.0, name=""):
    return StraightToItem("straight_to", x, y, name=name)


def order(items, most=10_000):
    """Return the items that a flow leads through, from the first to the end."""
    flow, at, passed = MissionFlow(items), 0, []
    while at < len(items) and len(passed) < most:
        if flow.leads(at):
            at = flow.follow(at)
        else:
            passed.append(at)
            at += 1
    return passed


def test_nested_repeats_are_the_nested_loops_of_a_program():
    a, b, c = (WaitItem("wait", 1.0, name) for name in "abc")
    items = (a, b, RepeatItem("repeat", "b", 3), c, RepeatItem("repeat", 1, 2))
    expected = [at for _ in range(2) for at in (0, 1, 1, 1, 3)]
    assert order(items) == expected


def test_a_jump_is_taken_so_often_in_the_whole_mission():
    a, b = WaitItem("wait", 1.0, "a"), WaitItem("wait", 1.0, "b")
    items = (a, JumpItem("jump", "a", 2), b, RepeatItem("repeat", times=2))
    assert order(items) == [0, 0, 0, 2, 0, 2]
    skipping = (a, JumpItem("jump", 4), b, a)
    assert order(skipping) == [0, 3]


ITEMS = st.lists(
    st.one_of(
        st.builds(WaitItem, st.just("wait"), st.just(1.0)),
        st.builds(RepeatItem, st.just("repeat"), st.integers(1, 6), st.integers(1, 3)),
        st.builds(JumpItem, st.just("jump"), st.integers(1, 6), st.integers(1, 3)),
    ),
    min_size=1,
    max_size=6,
).map(tuple)


@settings(max_examples=100, deadline=None)
@given(ITEMS)
def test_what_is_accepted_with_counts_ends_whatever_leads_where(items):
    if not list(flow_problems(items)):
        assert len(order(items, 4000)) < 4000


@settings(max_examples=100, deadline=None)
@given(ITEMS, st.integers(0, 20))
def test_a_flow_resumed_with_its_counts_goes_on_as_if_nothing_had_been(items, after):
    if list(flow_problems(items)):
        return
    whole = flow = MissionFlow(items)
    at = 0
    for step in range(after + 40):
        if at == len(items):
            break
        if step == after:
            flow = MissionFlow(items)
            flow.resume(whole.counts)
        if whole.leads(at):
            followed = whole.follow(at)
            if flow is not whole:
                assert flow.follow(at) == followed
            at = followed
        else:
            at += 1
    assert flow.counts == whole.counts


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "jump"\nto = "ledt"', r'm\.toml:10: item\[1\]\.to: .*"ledt"; did you mean "left"'),
        ('kind = "jump"\nto = 7', r"m\.toml:10: .*to: 7 found; the mission has items 1 to 2"),
        ('kind = "jump"\nto = "left"\ntimes = 0', r"m\.toml:11: .*times: must be at least 1"),
        ('kind = "repeat"\nfirst = 2', r"m\.toml:10: .*first: item 2 found; an item before this"),
        ('kind = "repeat"', r"m\.toml:7: item\[1\]\.times: needed here: .* none of them drives"),
        ('kind = "jump"\nto = 2', r"m\.toml:8: item\[1\]\.times: needed here"),
        ('kind = "wait_for"', r"m\.toml:7: .*one of clear_ahead_m, charge_percent and go_ahead"),
        ('kind = "wait_for"\ncharge_percent = 120', r"m\.toml:9: .*at most 100, not 120"),
    ],
)
def test_a_file_that_leads_nowhere_is_refused_with_its_line(text, message):
    first = '[[item]]\nkind = "wait"\nduration_s = 1.0\n[[item]]\n'
    named = first.replace("1.0\n", '1.0\nname = "left"\n')
    with pytest.raises(ConfigError, match=message):
        parse_mission(
            HEAD + (named if "jump" in text or "first" in text else first) + text, "m.toml"
        )


def test_two_items_of_one_name_are_no_target(differential, make_run):
    twice = mission(there(1.5, name="a"), there(2.0, name="a"), JumpItem("jump", "a", 1))
    with pytest.raises(MissionError, match=r'item 3 \(jump\): to: items 1 and 2 have the name "a"'):
        make_run(differential, mission=twice)


def test_a_patrol_without_end_that_drives_is_allowed():
    assert not list(flow_problems((there(2.0), WaitItem("wait", 1.0), RepeatItem("repeat"))))


def test_a_block_is_driven_three_times_also_through_interruptions_and_a_restart(robot, make_run):
    rounds = mission(there(2.5, name="out"), WaitItem("wait", BLINK), RepeatItem("repeat", 2, 3))
    run = make_run(robot, mission=rounds)
    run.step(AUTO)
    out = run.until(lambda out: out.state.item == 1, 30.0)
    run.step(HOLD)
    assert run.step(AUTO).state.item == 1
    out = run.until(lambda out: out.state.loop_counts == (1,), 10.0)
    assert out.state.loops == "item 3 (repeat): 2 of 3"
    second = make_run(robot, mission=rounds, start=run.world.pose)
    second.navigator.auto.resume(out.state.item, out.state.item_s_m, out.state.loop_counts)
    second.step(AUTO)
    out = second.until(lambda out: out.state.mission_completed, 10.0)
    assert sum("item 2 (wait)" in each for each in second.messages) <= 2
    assert out.state.loop_counts == (0,)


def test_items_that_are_done_at_once_are_no_endless_step(differential, make_run):
    run = make_run(differential, mission=mission(there(1.0), RepeatItem("repeat")))
    run.step(AUTO)
    for _ in range(5):
        out = run.step()
        assert (out.v_m_s, out.omega_rad_s) == (0.0, 0.0)
    assert out.state.loop_counts[0] >= 5


def test_an_operator_gives_the_go_ahead_once_and_only_where_it_is_waited_for(
    differential, make_run
):
    items = (there(1.3), WaitForItem("wait_for", go_ahead=True), there(1.6), RepeatItem("repeat"))
    run = make_run(differential, mission=mission(*items))
    assert "not under way" in run.step(GoAheadRequest()).state.message
    run.step(AUTO)
    assert "nothing waits" in run.step(GoAheadRequest()).state.message
    for _ in range(2):
        out = run.until(lambda out: out.state.waits, 20.0)
        assert (
            "waits for the go-ahead of an operator" in out.state.message
            or "refused" in out.state.message
        )
        run.step(HOLD)
        run.step(AUTO)
        assert run.step().state.waits
        assert not run.step(GoAheadRequest()).state.waits


def test_the_way_ahead_has_to_stay_clear_for_a_second(robot, make_run):
    run = make_run(robot, mission=mission(WaitForItem("wait_for", clear_ahead_m=1.5)))
    x = run.world.pose.x_m + robot.front + 0.8
    run.world.obstacle = [(x, 0.7, x, 1.3)]
    run.step(AUTO)
    for _ in range(60):
        out = run.step()
    assert "1.5 m of free way ahead (front measures" in out.state.message
    run.world.obstacle = None
    begin_ns = run.now_ns
    run.until(lambda out: out.state.mission_completed, 3.0)
    assert 1.0 <= (run.now_ns - begin_ns) / 1e9 < 1.4


def test_a_battery_is_waited_for_and_an_unknown_one_is_not_full(differential, make_run):
    run = make_run(differential, mission=mission(WaitForItem("wait_for", charge_percent=80.0)))
    run.step(AUTO)
    assert "a charge of 80 % (unknown)" in run.step().state.message
    run.charge = 0.79
    assert "(79 % now)" in run.step().state.message
    run.charge = 0.81
    assert run.step().state.mission_completed


def test_an_operator_jumps_by_number_and_name_and_aborts(differential, make_run):
    run = make_run(
        differential, mission=mission(there(3.0), there(1.3, name="near"), WaitItem("wait", 9.0))
    )
    run.step(AUTO)
    out = run.step(JumpRequest("neat"))
    assert out.state.item == 0
    assert 'no item has the name "neat"; did you mean "near"?' in out.state.message
    assert run.step(JumpRequest("near")).state.item == 1
    out = run.step(JumpRequest(3))
    assert (out.state.item, out.state.mode) == (2, Mode.AUTO)
    out = run.step(AbortRequest())
    assert (out.state.item, out.state.mode, out.v_m_s) == (0, Mode.HOLD, 0.0)
    assert out.state.mission_runs == 1


def test_another_mission_is_taken_when_none_is_under_way(differential, make_run):
    run = make_run(differential, mission=mission(there(3.0)))
    other = Mission("other", StartPose(1.0, 1.0), (there(1.3),))
    run.step(AUTO)
    out = run.step(LoadRequest(other))
    assert (out.state.mission, out.state.mode) == ("test", Mode.AUTO)
    assert "pause or abort it first" in out.state.message
    run.step(AbortRequest())
    out = run.step(LoadRequest(other))
    assert (out.state.mission, out.state.items, out.state.mission_runs, out.state.message) == (
        "other",
        1,
        2,
        "",
    )
    run.step(AUTO)
    assert run.until(lambda out: out.state.mission_completed, 20.0).state.mission == "other"
    planned = Mission("plan", StartPose(1.0, 1.0), (GotoItem("goto", 2.0, 1.0),))
    assert "neither a map nor a lidar" in run.step(LoadRequest(planned)).state.message


def test_exploring_in_guided_needs_a_pilot_and_says_so(differential, make_run):
    run = make_run(differential)
    run.step(ModeRequest(Mode.GUIDED))
    out = run.step(ExploreRequest())
    assert (out.state.goals, out.state.goal_reached) == (1, False)
    assert "neither a map nor a lidar" in out.state.message


def test_a_failure_stays_known_when_the_item_is_tried_again(differential, make_run):
    run = make_run(
        differential, mission=mission(StraightToItem("straight_to", 3.0, 1.0, time_out_s=0.2))
    )
    run.step(AUTO)
    out = run.until(lambda out: out.state.mission_failed, 5.0)
    assert "not done after" in out.state.trouble
    out = run.step(AUTO)
    assert not out.state.mission_failed
    assert "not done after" in out.state.trouble
