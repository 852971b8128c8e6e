"""Rally points: taken, told, kept, cleared, and apart from mission and fence."""

import math

from pymavlink.dialects.v20 import common as m

from robotctl.app.processes.plan_files import PlanFiles, load_bounds
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.fence import SetRally

RALLY, POINT, NED = m.MAV_MISSION_TYPE_RALLY, m.MAV_CMD_NAV_RALLY_POINT, m.MAV_FRAME_LOCAL_NED
PLACES = ((2.0, 1.0), (5.0, -3.0))


def item(seq, place, command=POINT):
    x, y = place
    return m.MAVLink_mission_item_int_message(
        1, 1, seq, NED, command, 0, 1, 0, 0, 0, math.nan,
        round(y * 1e4), round(x * 1e4), 0.0, RALLY,
    )  # fmt: skip


class Navigation:
    """The navigation process, as far as its rally points go."""

    def __init__(self, bench):
        self.bench, self.crc, self.places = bench, 0, ()
        self.step()
        bench.take()

    def step(self):
        state = self.bench.navigation(rally_crc=self.crc)
        for request in self.bench.step(state, self.bench.control()):
            if isinstance(request, SetRally):
                self.crc, self.places = request.crc, request.places

    def upload(self, items):
        self.bench.receive(m.MAVLink_mission_count_message(1, 1, len(items), RALLY))
        for _ in range(30):
            self.step()
            for sent, _ in self.bench.take():
                if sent.get_type() == "MISSION_ACK":
                    return sent.type, sent.mission_type
                if sent.get_type() == "MISSION_REQUEST_INT":
                    self.bench.receive(items[sent.seq])
        raise AssertionError("no answer")

    def count(self):
        self.bench.receive(m.MAVLink_mission_request_list_message(1, 1, RALLY))
        self.step()
        (count,) = self.bench.messages("MISSION_COUNT")
        return count.count, count.mission_type


def test_rally_points_are_taken_kept_and_cleared(make_bench, tmp_path):
    stores = {"rally points": PlanFiles(str(tmp_path), "rally points")}
    bench = make_bench()
    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, stores=stores)
    navigation = Navigation(bench)
    items = [item(seq, place) for seq, place in enumerate(PLACES)]
    assert navigation.upload(items) == (m.MAV_MISSION_ACCEPTED, RALLY)
    assert navigation.places == PLACES
    assert navigation.count() == (2, RALLY)
    (kept,) = load_bounds(str(tmp_path), "rally points")
    assert (kept.places, kept.crc) == (PLACES, navigation.crc)
    bad = [item(0, PLACES[0]), item(1, PLACES[1], 16)]
    assert navigation.upload(bad) == (m.MAV_MISSION_UNSUPPORTED, RALLY)
    assert navigation.places == PLACES
    bench.receive(m.MAVLink_mission_clear_all_message(1, 1, RALLY))
    navigation.step()
    navigation.step()
    assert navigation.places == ()
    assert load_bounds(str(tmp_path), "rally points") == ()
