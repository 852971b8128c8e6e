"""Ground stations: who is there, on which link, and when they are lost."""

import itertools

from pymavlink.dialects.v20 import common

from robotctl.messages.control import GroundStationPresence, Notice, SafetyState
from robotctl.messages.mavlink_port import LinkConfig, Peer


def heartbeat(kind=common.MAV_TYPE_GCS):
    return common.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)


def test_a_ground_station_is_there_while_its_heartbeat_is_heard(make_bench):
    bench = make_bench(links=2, gcs_timeout_s=3.0)
    bench.receive(heartbeat(), peer=Peer(0, 0))
    bench.receive(heartbeat(), peer=Peer(1, 0))
    bench.step()
    (station,) = bench.telemetry.ground_stations
    assert (station.system_id, station.component_id, station.links) == (255, 190, (0, 1))
    for _ in range(5):
        bench.receive(heartbeat(), peer=Peer(1, 0))
        bench.run(1.0)
    assert bench.telemetry.ground_stations[0].links == (1,)
    bench.run(3.1)
    assert bench.telemetry.ground_stations == ()


def test_coming_and_going_are_said_once_each_and_handed_to_the_process(bench):
    for _ in range(3):
        bench.receive(heartbeat())
        bench.run(1.0)
    bench.run(6.0)
    assert bench.texts() == ["Ground station 255 connected", "Ground station 255 is lost"]
    notices = bench.telemetry.take_notices()
    assert [(notice.severity, notice.text[-4:]) for notice in notices] == [(6, "cted"), (4, "lost")]
    assert bench.telemetry.take_notices() == []


def test_heartbeats_of_other_vehicles_do_not_count(bench):
    bench.receive(heartbeat(common.MAV_TYPE_QUADROTOR), system=2)
    bench.receive(heartbeat(common.MAV_TYPE_ONBOARD_CONTROLLER), system=1, component=191)
    bench.step()
    assert bench.telemetry.ground_stations == ()


def test_invented_ground_stations_do_not_fill_the_memory(bench):
    for system in range(2, 255):
        bench.receive(heartbeat(), system=system)
    bench.step()
    assert len(bench.telemetry.ground_stations) == 32
    bench.run(20.0)
    assert len(bench.telemetry.take_notices()) <= 64


def test_what_was_said_while_nobody_was_there_is_said_again_once_with_its_age(bench):
    bench.step(Notice(0, 6, "the camera sees the floor"), Notice(0, 2, "stopped: no feedback"))
    bench.run(9.98)
    bench.step(Notice(0, 4, "one line\nand another"))
    sent = ["the camera sees the floor", "stopped: no feedback", "one line", "and another"]
    assert bench.texts() == sent

    bench.take()
    bench.receive(heartbeat())
    bench.run(1.0)
    again = [(text.severity, text.text) for text, _ in bench.take("STATUSTEXT")]
    assert again == [
        (2, "stopped: no feedback (10 s ago)"),
        (4, "one line (0.0 s ago)"),
        (4, "and another (0.0 s ago)"),
        (6, "Ground station 255 connected"),
    ]

    bench.step(Notice(0, 4, "said to its face"))
    bench.receive(heartbeat(), system=254)
    bench.run(1.0)
    assert bench.texts() == ["said to its face", "Ground station 254 connected"]


def test_a_ground_station_that_was_lost_hears_why_the_robot_stands(bench):
    bench.receive(heartbeat())
    bench.run(6.0)
    bench.step(Notice(0, 2, "stopped: no commands"))
    bench.take()
    bench.receive(heartbeat())
    bench.run(1.0)
    lost, stopped, here = bench.texts()
    assert (lost[:30], here) == ("Ground station 255 is lost (1.", "Ground station 255 connected")
    assert stopped == "stopped: no commands (0.0 s ago)"


def test_a_ground_station_that_vanishes_while_it_is_told_hears_the_rest_with_one_age(bench):
    for number in range(12):
        bench.step(Notice(0, 4, f"trouble {number}"))
    bench.run(10.0)
    bench.take()
    bench.receive(heartbeat())
    bench.step()
    told = bench.texts()
    bench.step(advance_s=10.0)
    bench.take()
    bench.receive(heartbeat())
    bench.run(1.0)
    told += [text for text in bench.texts() if text.startswith("trouble")]
    ages = [text.partition(" (")[2] for text in told]
    assert [text.split(" (")[0] for text in told] == [f"trouble {n}" for n in range(12)]
    assert ages == ["10 s ago)"] * 4 + ["20 s ago)"] * 8


def test_only_the_last_texts_wait_for_a_ground_station(bench):
    for number in range(40):
        bench.step(Notice(0, 4, f"trouble {number}"))
    bench.take()
    bench.receive(heartbeat())
    bench.run(1.0)
    texts = bench.texts()
    assert [text.split(" (")[0] for text in texts[:-1]] == [f"trouble {n}" for n in range(24, 40)]


def test_what_is_said_again_and_again_does_not_hide_why_the_robot_stands(bench):
    bench.step(Notice(0, 2, "stopped: no feedback"))
    for _ in range(40):
        bench.step(Notice(0, 4, "logging stopped: disk full"))
    bench.run(2.0)
    bench.take()
    bench.receive(heartbeat())
    bench.step()
    assert bench.texts() == [
        "stopped: no feedback (2.8 s ago)",
        "logging stopped: disk full (2.0 s ago)",
        "Ground station 255 connected",
    ]


LINK = (LinkConfig("udpin:127.0.0.1:0"),)


def presences(requests):
    return [each.stamp_ns for each in requests if isinstance(each, GroundStationPresence)]


def test_navigation_is_told_that_a_station_is_there_where_it_must_be(make_bench):
    bench = make_bench(gcs_timeout_s=3.0, hold_without_gcs=True, link=LINK)
    assert presences(bench.run(1.0)) == []
    bench.receive(heartbeat(common.MAV_TYPE_ONBOARD_CONTROLLER))
    assert presences(bench.run(1.0)) == []
    begin_ns = bench.now_ns
    bench.receive(heartbeat())
    told = presences(bench.run(8.0))
    assert told[0] - begin_ns <= 40_000_000
    assert 2.7e9 < told[-1] - begin_ns <= 3.1e9
    assert all(0 < after - before <= 240_000_000 for before, after in itertools.pairwise(told))


def test_it_is_not_told_where_nobody_need_be_there(make_bench):
    bench = make_bench(link=LINK, hold_on_gcs_loss=False)
    bench.receive(heartbeat())
    assert presences(bench.run(1.0)) == []


def watched(bench, seconds, *systems):
    """Return the last heartbeat that navigation is told of, while some stations send theirs [s]."""
    begin_ns, told = bench.now_ns, []
    for _ in range(round(seconds)):
        for system in systems:
            bench.receive(heartbeat(), system=system)
        told += [each for each in bench.run(1.0) if isinstance(each, GroundStationPresence)]
    return (told[-1].heard_ns - begin_ns) / 1e9 if told else None


def test_the_station_whose_loss_counts_is_the_operators_once_it_was_heard(make_bench):
    bench = make_bench(gcs_timeout_s=3.0, gcs_system_id=255)
    assert watched(bench, 3, 42) > 1.9
    assert watched(bench, 3, 42, 255) > 1.9
    assert watched(bench, 2, 42) < 0.0  # that of the operator, who has been silent since
    assert watched(bench, 3, 42) > 1.9  # after the loss the other one's
    assert watched(bench, 5) < 0.0
    assert watched(bench, 1) is None


REASON = "no feedback"


def stopped(bench, since_ns):
    """Return the state of a robot that has been stopped since a time."""
    return bench.control(state=SafetyState.FAULT, reason=REASON, stopped_ns=since_ns)


def test_a_stop_while_telemetry_was_away_is_explained_with_its_age(bench):
    """A process that has just started, and the ground station that it meets."""
    since_ns = bench.now_ns - 3_880_000_000
    bench.receive(heartbeat())
    for _ in range(100):
        bench.step(stopped(bench, since_ns))
    assert bench.texts() == ["Ground station 255 connected", f"stopped: {REASON} (3.9 s ago)"]


def test_a_notice_that_waited_for_this_process_has_its_age(bench):
    bench.receive(heartbeat())
    bench.step(bench.control())
    bench.texts()
    bench.step(Notice(bench.now_ns - 3_880_000_000, 2, f"stopped: {REASON}"))
    assert bench.texts() == [f"stopped: {REASON} (3.9 s ago)"]
    bench.step(Notice(bench.now_ns - 980_000_000, 2, f"stopped: {REASON}"))
    assert bench.texts() == [f"stopped: {REASON}"]


def test_each_ground_station_that_comes_hears_why_the_robot_stands(bench):
    bench.receive(heartbeat())
    bench.step(bench.control())
    since_ns = bench.now_ns
    bench.step(Notice(0, 2, f"stopped: {REASON}"), stopped(bench, since_ns))
    bench.texts()
    for station in (255, 254):  # the first one knows it
        bench.receive(heartbeat(), system=station)
    bench.step(stopped(bench, since_ns), advance_s=1.98)
    bench.step(stopped(bench, since_ns))
    assert bench.texts() == ["Ground station 254 connected", f"stopped: {REASON} (2.0 s ago)"]


def test_a_station_that_was_lost_hears_of_a_stop_of_before_its_loss_was_noticed(bench):
    """What is sent between the last frame that arrives and the loss, nobody hears."""
    bench.receive(heartbeat())
    bench.step(bench.control())
    since_ns = bench.now_ns
    bench.step(Notice(0, 2, f"stopped: {REASON}"), stopped(bench, since_ns))
    bench.run(7.0, state=SafetyState.FAULT, reason=REASON, stopped_ns=since_ns)
    bench.texts()
    bench.receive(heartbeat())
    bench.run(1.0, state=SafetyState.FAULT, reason=REASON, stopped_ns=since_ns)
    told = [each for each in bench.texts() if each.startswith("stopped")]
    assert told == [f"stopped: {REASON} (7.0 s ago)"]


def test_why_navigation_holds_is_said_to_a_station_that_comes(bench):
    held = {"held": True, "message": "hold: the ground station is lost"}
    bench.step(bench.control(), bench.navigation(**held))
    bench.texts()
    bench.receive(heartbeat())
    bench.step(bench.control(), bench.navigation(**held))
    bench.step(bench.control(), bench.navigation(**held))
    assert "hold: the ground station is lost" in [each.partition(" (")[0] for each in bench.texts()]


def test_a_robot_that_may_drive_has_nothing_to_explain(bench):
    bench.step(bench.control(state=SafetyState.STANDBY, reason="", stopped_ns=bench.now_ns))
    bench.receive(heartbeat())
    bench.step(bench.control(state=SafetyState.STANDBY, reason=""))
    assert bench.texts() == ["Ground station 255 connected"]
