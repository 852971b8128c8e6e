"""Ground stations: who is there, on which link, and when they are lost."""

from pymavlink.dialects.v20 import common

from robotctl.runtime.mavlink_port import Peer


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
    assert bench.texts() == ["Ground station 255 is here", "Ground station 255 is lost"]
    notices = bench.telemetry.take_notices()
    assert [(notice.severity, notice.text[-4:]) for notice in notices] == [(6, "here"), (4, "lost")]
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
