"""The server by foreign clients: requests to the robot, driving and stops."""

from __future__ import annotations

import json
import socket
import time

from robotctl.messages.control import (
    Ack,
    Arm,
    EmergencyStop,
    ManualControl,
    Mode,
    PositionTarget,
    SafetyState,
    SetMode,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.web import driving
from tests.web.clients import drive, of, take_over, wait
from tests.web.conftest import control_state, navigation_state


def test_arming_is_asked_of_control_and_its_reasons_come_back(served):
    served.robot.state = SafetyState.STANDBY
    with served.client() as client:
        client.synchronise()
        client.send("ArmRequest", id=5, at_ms=client.at_ms(), arm=True)
        (arm,) = wait(lambda: of(served.robot.control, Arm))
        assert arm.arm
        reason = Fault(FaultCode.BUS_OFF, "the bus is off")
        ack = Ack(arm.request_id, accepted=False, reasons=(reason,))
        served.robot.publish(control_state(SafetyState.STANDBY, acks=(ack,)))
        answer = client.read("Refused")
        assert answer["id"] == 5
        assert str(reason) in answer["reason"]


def test_a_click_of_long_ago_moves_nothing_but_hold_and_disarm_always_count(served):
    with served.client() as client:
        client.synchronise()
        old_ms = client.at_ms() - 1500.0
        client.send("ModeRequest", id=1, at_ms=old_ms, mode=10)
        assert "late" in client.read("Refused")["reason"]
        client.send("GoTo", id=2, at_ms=old_ms, x_m=1.0, y_m=1.0, heading_rad=None)
        assert "late" in client.read("Refused")["reason"]
        client.send("ArmRequest", id=3, at_ms=old_ms, arm=True)
        assert "late" in client.read("Refused")["reason"]
        client.send("ModeRequest", id=4, at_ms=client.at_ms() + 1000.0, mode=10)
        assert "ahead" in client.read("Refused")["reason"]
        client.send("ModeRequest", id=5, at_ms=old_ms, mode=4)
        client.send("ArmRequest", id=6, at_ms=old_ms, arm=False)
        wait(lambda: of(served.robot.control, Arm))
    assert [each.mode for each in of(served.robot.navigation, SetMode)] == [Mode.HOLD]
    assert [each.arm for each in of(served.robot.control, Arm)] == [False]


def test_go_to_asks_for_guided_and_the_place_of_an_armed_robot_only(served):
    with served.client() as client:
        client.synchronise()
        client.read("ControlState")
        client.send("GoTo", id=1, at_ms=client.at_ms(), x_m=1.0, y_m=2.0, heading_rad=None)
        (target,) = wait(lambda: of(served.robot.navigation, PositionTarget))
        assert (target.x_m, target.y_m, target.heading_rad) == (1.0, 2.0, None)
        assert of(served.robot.navigation, SetMode)[0].mode is Mode.GUIDED
        served.robot.state = SafetyState.STANDBY
        client.read("ControlState", where=lambda message: message["state"] == SafetyState.STANDBY)
        client.send("GoTo", id=2, at_ms=client.at_ms(), x_m=1.0, y_m=2.0, heading_rad=None)
        assert "arm first" in client.read("Refused", where=lambda m: m["id"] == 2)["reason"]


def test_a_mode_that_navigation_does_not_take_is_refused_in_its_words(served):
    served.robot.publish(navigation_state(Mode.HOLD, "no mission"))
    with served.client() as client:
        client.synchronise()
        client.send("ModeRequest", id=3, at_ms=client.at_ms(), mode=10)
        answer = client.read("Refused")
        assert answer["id"] == 3
        assert "no mission" in answer["reason"]


def test_the_robot_follows_the_sticks_of_its_driver_alone(served):
    with served.client() as one, served.client() as two:
        take_over(one)
        sample = 0
        while not (sticks := of(served.robot.navigation, ManualControl)):  # late ones count not
            sample = drive(one, 0.1, sample, held=False)
            sample = drive(one, 0.3, sample, turn=-0.25)
        assert served.robot.navigation[0].mode is Mode.MANUAL
        assert {(each.forward, each.turn) for each in sticks} == {(0.5, -0.25)}
        assert all(each.expires_ns - each.stamp_ns <= 300_000_000 for each in sticks)
        two.synchronise()
        two.send("GoTo", id=4, at_ms=two.at_ms(), x_m=1.0, y_m=1.0, heading_rad=None)
        assert "drives" in two.read("Refused")["reason"]
        drive(two, 0.2, forward=-1.0)
        assert not [each for each in of(served.robot.navigation, ManualControl) if each.forward < 0]
        two.send("TakeDriving", id=5, at_ms=two.at_ms())
        asked = one.read("Driver", where=lambda message: message["asking"] is not None)
        one.send("GiveDriving")
        assert two.read("Driver", where=lambda m: m["client"] == asked["asking"])
        assert of(served.robot.navigation, ManualControl)[-1].forward == 0.0


def test_sticks_that_were_recorded_and_are_sent_again_do_nothing(served):
    with served.client() as client:
        take_over(client)
        lines = []
        for sample, held in enumerate([False] * 3 + [True] * 5):
            line = {"type": "Sticks", "sample": sample, "at_ms": client.at_ms(), "held": held,
                    "forward": 1.0, "turn": 0.0, "sideways": 0.0}  # fmt: skip
            lines.append(json.dumps(line))
            client.ws.send(lines[-1])
            time.sleep(0.02)
        client.send("GiveDriving")
    wait(lambda: len(served.page._live) == 0)
    served.robot.navigation.clear()
    with served.client() as client:
        take_over(client)
        time.sleep(0.3)
        for line in lines * 3:
            client.ws.send(line)
        client.synchronise()
    moved = [each for each in of(served.robot.navigation, ManualControl) if each.forward]
    assert moved == []


def test_a_driver_whose_connection_is_cut_is_at_rest_at_once(served):
    client = served.client()
    take_over(client)
    drive(client, 0.3, drive(client, 0.1, held=False))
    client.ws.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    begin_s = time.monotonic()
    client.ws.socket.close()
    wait(lambda: served.robot.navigation[-1].forward == 0.0)
    assert time.monotonic() - begin_s < 0.4


def test_a_driver_that_falls_silent_is_at_rest_in_200_ms(served):
    with served.client() as client:
        take_over(client)
        drive(client, 0.3, drive(client, 0.1, held=False))
        begin_s = time.monotonic()
        wait(lambda: served.robot.navigation[-1].forward == 0.0)
        assert time.monotonic() - begin_s < 0.3
        told = client.read("Driver", where=lambda message: message["locked"])
        assert "stood still" in told["locked"]


def test_a_robot_that_loses_power_needs_a_fresh_edge(served):
    with served.client() as client:
        take_over(client)
        sample = drive(client, 0.3, drive(client, 0.1, held=False))
        served.robot.state = SafetyState.STANDBY
        sample = drive(client, 0.3, sample)
        served.robot.state = SafetyState.ARMED
        time.sleep(0.05)
        served.robot.navigation.clear()
        sample = drive(client, 0.3, sample)
        assert of(served.robot.navigation, ManualControl) == []
        drive(client, 0.2, drive(client, 0.1, sample, held=False))
        assert of(served.robot.navigation, ManualControl)


def test_another_mode_takes_the_sticks_away(served, monkeypatch):
    # A computer that stands still for a moment is not the cause that is looked for here.
    monkeypatch.setattr(driving, "OLDEST_NS", 10_000_000_000)
    monkeypatch.setattr(driving, "STANDING_NS", 10_000_000_000)
    with served.client() as client:
        take_over(client)
        sample = drive(client, 0.2, drive(client, 0.1, held=False))
        served.robot.publish(navigation_state(Mode.MANUAL))
        sample = drive(client, 0.2, sample)
        served.robot.publish(navigation_state(Mode.HOLD))
        drive(client, 0.2, sample)
        assert served.robot.navigation[-1].forward == 0.0
        told = client.read("Driver", where=lambda message: message["locked"])
        assert "HOLD" in told["locked"]


def test_a_stop_is_sent_and_answered_with_what_control_says(served):
    with served.client("/stop") as client:
        client.send("Ping", t=1.0)
        assert client.read("Pong")["t"] == 1.0
        client.send("Stop", id=3)
        wait(lambda: of(served.robot.control, EmergencyStop))
        served.robot.publish(control_state(SafetyState.EMERGENCY_STOP, "operator"))
        answer = client.read("StopSeen")
        assert (answer["id"], answer["state"]) == (3, SafetyState.EMERGENCY_STOP)
        assert answer["reason"] == "operator"
        assert 0.0 < answer["after_ms"] < 500.0
        time.sleep(0.7)
        assert len(of(served.robot.control, EmergencyStop)) == 1


def test_a_stop_that_is_not_answered_is_repeated_and_that_is_said(served):
    served.robot.is_silent = True
    with served.client("/stop") as client:
        client.send("Stop", id=3)
        answer = client.read("StopSeen")
        assert answer["state"] is None
        assert 450.0 < answer["after_ms"] < 900.0
    sent = len(of(served.robot.control, EmergencyStop))
    wait(lambda: len(of(served.robot.control, EmergencyStop)) > sent, what="not repeated")
    served.robot.publish(control_state(SafetyState.EMERGENCY_STOP, "operator"))
    wait(lambda: served.robot.published == [])
    time.sleep(0.1)
    sent = len(of(served.robot.control, EmergencyStop))
    time.sleep(0.7)
    assert len(of(served.robot.control, EmergencyStop)) == sent


def test_an_older_state_of_emergency_is_no_answer(served):
    served.robot.is_silent = True
    with served.client("/stop") as client:
        before_ns = time.monotonic_ns()
        client.send("Stop", id=3)
        wait(lambda: of(served.robot.control, EmergencyStop))
        served.robot.publish(control_state(SafetyState.FAULT, "old", stamp_ns=before_ns - 1))
        assert client.read("StopSeen")["state"] is None
