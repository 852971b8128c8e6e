"""The contract of each kind of drive of `DRIVES`, host against twin, on robots that have it."""

from __future__ import annotations

import dataclasses
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.bus.frame import BIT_RATE_SWITCH_FLAG
from robotctl.config.robot_file import config_directory, load_robot
from robotctl.drivers.can.drives.registry import DRIVES
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import EmergencyStopSource, StrangerKind
from tests.drivers.can.drives.drive_rig import MS, OFF, DriveRig

ROBOTS = sorted(path.stem for path in config_directory().glob("*.toml"))
KINDS = {name: {motor.kind for motor in load_robot(path).motors}
         for name in ROBOTS for path in [config_directory() / f"{name}.toml"]}  # fmt: skip
EACH_KIND = [next(robot for robot in ROBOTS if kind in KINDS[robot])
             for kind in sorted({kind for kinds in KINDS.values() for kind in kinds})]  # fmt: skip
"""One robot for each kind of drive."""


@pytest.fixture(scope="module", params=ROBOTS)
def any_robot(request):
    return request.param


def test_each_kind_of_drive_has_a_robot_that_can_be_simulated():
    kinds = {str(field.type) for kind in DRIVES for field in dataclasses.fields(kind)
             if field.name == "kind"}  # fmt: skip
    assert len(kinds) == len(DRIVES)
    there = {kind for kinds in KINDS.values() for kind in kinds}
    assert {f"Literal['{kind}']" for kind in there} == {each.replace('"', "'") for each in kinds}


def test_a_robot_comes_into_service_and_its_wheels_obey_in_both_directions(any_robot):
    rig = DriveRig(any_robot).commission()
    assert not rig.powered
    assert rig.states <= {DriveState.READY}
    for share in (1.0, -1.0):
        before = [each.position_ticks for each in rig.feedback.actuators]
        wheels = [place for place, each in enumerate(rig.actuators) if each.ticks_per_revolution]
        feedback = rig.drive(share, 800)
        assert rig.states == {DriveState.ENABLED}
        for place, true_rad_s in zip(wheels, rig.wheels_rad_s, strict=True):
            report, actuator = feedback.actuators[place], rig.actuators[place]
            assert math.copysign(1.0, true_rad_s) == math.copysign(1.0, share)
            assert abs(true_rad_s) > 1.0
            moved = (report.position_ticks - before[place] + 0x8000) % 0x10000 - 0x8000
            assert math.copysign(1.0, moved) == math.copysign(1.0, share)
            if actuator.abilities.tells_speed:
                assert report.speed_rad_s == pytest.approx(true_rad_s, abs=0.5)
        rig.run(1500)
        assert not rig.powered
        if all(actuator.abilities.brakes for actuator in rig.actuators):
            assert max(map(abs, rig.wheels_rad_s)) < 0.2


def test_positions_are_those_of_the_wheels(any_robot):
    rig = DriveRig(any_robot).commission()
    rig.drive(1.0, 300)
    wheels = [place for place, each in enumerate(rig.actuators) if each.ticks_per_revolution]
    start = [rig.feedback.actuators[place].position_ticks for place in wheels]
    began = [axis.angle_rad for axis in rig.simulation.plant.axes]
    last, sums = start, [0] * len(start)
    for _ in range(100):
        feedback = rig.tick(rig.command(1.0))
        now = [feedback.actuators[place].position_ticks for place in wheels]
        steps = [(new - old + 0x8000) % 0x10000 - 0x8000
                 for new, old in zip(now, last, strict=True)]  # fmt: skip
        sums, last = [total + step for total, step in zip(sums, steps, strict=True)], now
    for place, total, axis, angle in zip(
        wheels, sums, rig.simulation.plant.axes, began, strict=True
    ):
        turned_rad = axis.angle_rad - angle
        told_rad = math.tau * total / rig.actuators[place].ticks_per_revolution
        assert told_rad == pytest.approx(turned_rad, abs=0.15)


@pytest.mark.parametrize("robot", EACH_KIND)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=4, deadline=None)
def test_without_a_host_no_wheel_has_power_after_the_time_out(robot, seed):
    rng = random.Random(seed)
    rig = DriveRig(robot, seed=seed % 1000).commission()
    rig.drive(rng.choice((-1.0, 0.3, 1.0)), rng.uniform(100, 700))
    rig.hold_still(rng.uniform(0, 5))
    rig.hold_still(rig.config.safety.command_timeout_ms * 1.1 + rig.period_ns / MS + 1)
    assert not rig.powered
    rig.hold_still(500)
    assert not rig.powered


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_may_be_armed_in_the_tick_in_which_it_comes_into_service(robot):
    rig = DriveRig(robot)

    def arm(feedback):
        return OFF if any(node.problem for node in feedback.nodes) else rig.command(1.0)

    for _ in range(2000):
        rig.tick(arm)
        if rig.states == {DriveState.ENABLED}:
            return
    raise AssertionError(rig.states)


@pytest.mark.parametrize("robot", EACH_KIND)
def test_after_a_silence_nothing_resumes_by_itself(robot):
    rig = DriveRig(robot).commission()
    rig.drive(1.0)
    rig.hold_still(300)
    rig.drive(1.0, 300)
    assert DriveState.ENABLED not in rig.states
    assert not rig.powered


@pytest.mark.parametrize("robot", EACH_KIND)
def test_an_emergency_stop_holds_until_it_is_cleared_and_asked_for_anew(robot):
    rig = DriveRig(robot).commission()
    rig.drive(1.0)
    rig.robot.emergency_stop(EmergencyStopSource.GROUND_STATION)
    rig.drive(1.0, 40)
    assert not rig.powered
    rig.drive(1.0, 300)
    assert not rig.powered
    assert rig.states == {DriveState.EMERGENCY_STOP}
    rig.run(300)
    rig.robot.clear_faults()
    rig.run(500)
    assert rig.states == {DriveState.READY}
    rig.drive(1.0)
    assert rig.states == {DriveState.ENABLED}
    assert min(rig.wheels_rad_s) > 1.0


@pytest.mark.parametrize("robot", [each for each in EACH_KIND if "native" not in KINDS[each]])
def test_a_drive_that_restarts_while_driving_stays_without_power(robot):
    """Our own leaves that to the control core, which disables all drives when a node restarts."""
    rig = DriveRig(robot).commission()
    rig.drive(1.0)
    name = rig.config.motors[0].name
    boots = {node.name: node.boots for node in rig.feedback.nodes}[name]
    rig.simulation.power_cycle(name)
    rig.drive(1.0, 3000)
    first = [place for place, each in enumerate(rig.actuators) if each.drive == name]
    assert all(rig.feedback.actuators[place].state != DriveState.ENABLED for place in first)
    rig.run(2000)
    status = {node.name: node for node in rig.feedback.nodes}[name]
    assert status.boots > boots
    assert not status.problem


@pytest.mark.parametrize("robot", EACH_KIND)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e39])
def test_a_command_that_no_wire_can_carry_is_no_power(robot, value):
    rig = DriveRig(robot).commission()
    rig.drive(1.0)
    command = rig.command(1.0)
    bad = ActuatorCommand(True, True, (value, *command.values[1:]))
    rig.run(60, bad)
    place = rig.simulation.config.drive.wheel_names.index(rig.actuators[0].name)
    assert not rig.simulation.plant.axes[place].powered
    assert rig.feedback.bus.send_failures > 0


@pytest.mark.parametrize("robot", EACH_KIND)
def test_another_host_on_the_bus_is_noticed(robot):
    """What we send, sent by somebody else: a frame that only the host may send."""
    rig = DriveRig(robot).commission()
    bus = rig.config.motors[0].bus or rig.config.buses[0].name
    sent = []
    rig.simulation.buses[bus].tap(sent.append)
    rig.drive(1.0, 20)
    part = rig.parts.drives[0].drive
    ours = [frame for frame in sent
            if frame.arbitration_id & ~BIT_RATE_SWITCH_FLAG in part.host_frames]  # fmt: skip
    assert ours
    stranger = rig.simulation.buses[bus].attach("stranger", lambda _: None)
    rig.simulation.advance(rig.simulation.now_ns + 2 * MS)  # two senders at once destroy each other
    stranger.send(ours[0].arbitration_id, ours[0].data)
    rig.drive(1.0, 20)
    kinds = {each.kind for each in rig.feedback.strangers}
    assert StrangerKind.HOST_FRAME in kinds


@pytest.mark.parametrize("robot", EACH_KIND)
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_no_frame_upsets_the_host_or_enables_a_drive(robot, data):
    rig = RIGS.setdefault(robot, DriveRig(robot))
    for fitted in rig.parts.drives:
        for number in fitted.drive.handlers:
            payload = data.draw(st.binary(max_size=64 if number > 0xFFFF_FFFF else 8))
            fitted.drive.handlers[number](payload, rig.clock.now_ns())
    rig.tick(OFF)
    assert not rig.powered


RIGS: dict[str, DriveRig] = {}
