"""A ground station by hand: it sends messages to a simulated robot, and waits for the answers."""

import math

from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.globe import Origin
from tests.mavlink.conftest import FakeLinks
from tests.mavlink.driven_robot import DrivenRobot

ORIGIN = 48.13, 11.57
SETTINGS = (
    f"mavlink.origin={{latitude_deg={ORIGIN[0]},longitude_deg={ORIGIN[1]},altitude_m=520.0}}",
)
START = (6.0, 5.0, 0.0)
ROBOT = 1, 1


def on_globe(x_m, y_m):
    """Return latitude and longitude of a place [1e-7 deg]."""
    return tuple(round(1e7 * degrees) for degrees in Origin(*ORIGIN).from_world(x_m, y_m))


class Station:
    """A station of a system and component, with its heartbeat, and a robot that it drives."""

    def __init__(
        self, system=255, component=190, kind=m.MAV_TYPE_GCS, personality="ardupilot", settings=()
    ):
        self.links, self.heard = FakeLinks(), []
        self.since = []
        """What came since something was sent."""
        self.robot = DrivenRobot(
            self.links,
            start=START,
            overrides=(*SETTINGS, f'mavlink.personality="{personality}"', *settings),
        )
        self._address, self._beat_ns = (system, component), 0
        self._beat = m.MAVLink_heartbeat_message(kind, m.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)

    def send(self, *messages):
        """Send messages, all at once."""
        self.since.clear()
        for message in messages:
            self.robot.send(message, *self._address)

    def listen(self, seconds):
        """Return what comes within a time."""
        heard, end_ns = [], self.robot.now_ns + seconds * 1e9
        while self.robot.now_ns < end_ns:
            if self.robot.now_ns - self._beat_ns >= 1e9:
                self._beat_ns = self.robot.now_ns
                self.robot.send(self._beat, *self._address)
            self.robot.tick()
            sent, self.links.sent = self.links.sent, []
            heard += [message for message, _ in sent]
        self.heard += heard
        self.since += heard
        return heard

    def expect(self, kind, within_s=1.0, **fields):
        """Return the first message of a kind with such fields that came since the last was sent."""
        for _ in range(round(100 * within_s)):
            for message in self.since:
                values = message.to_dict()
                if message.get_type() == kind and fields.items() <= values.items():
                    return message
            self.listen(0.01)
        told = [str(each) for each in self.since if each.get_type() not in {"HEARTBEAT"}]
        raise AssertionError(f"no {kind} {fields} within {within_s} s, but {told}")

    def command(self, number, *params, confirmation=0, to=ROBOT):
        """Send a command as COMMAND_LONG, and expect that it is accepted."""
        params = (*params, *[0.0] * (7 - len(params)))
        self.send(m.MAVLink_command_long_message(*to, number, confirmation, *params))
        return self.expect("COMMAND_ACK", 2.0, command=number, result=m.MAV_RESULT_ACCEPTED)

    def command_int(self, number, *params, place, frame=m.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT):
        """Send a command as COMMAND_INT, and expect that it is accepted."""
        self.send(m.MAVLink_command_int_message(*ROBOT, frame, number, 0, 0, *params, *place, 0.0))
        return self.expect("COMMAND_ACK", 2.0, command=number, result=m.MAV_RESULT_ACCEPTED)

    def until(self, condition, within_s):
        """Wait for something that is so."""
        for _ in range(round(10 * within_s)):
            if condition():
                return
            self.listen(0.1)
        texts = [each.text for each in self.heard if each.get_type() == "STATUSTEXT"]
        raise AssertionError(f"not within {within_s} s, {self.robot.state}, {texts}")

    def is_near(self, x_m, y_m):
        """Say whether the robot is at a place."""
        return math.dist(self.robot.pose()[:2], (x_m, y_m)) < 0.15

    def parameters(self, seconds=4.0):
        """Return all parameters that a list has, by name."""
        self.send(m.MAVLink_param_request_list_message(*ROBOT))
        heard = self.listen(seconds)
        values = [each for each in heard if each.get_type() == "PARAM_VALUE"]
        assert {each.param_index for each in values} == set(range(values[0].param_count))
        return {each.param_id: each for each in values}

    def upload(self, kind, items, *, make=m.MAVLink_mission_item_int_message, within_s=1.5):
        """Send items of a kind of plan as they are asked for; the answer has to come in time."""
        self.send(m.MAVLink_mission_count_message(*ROBOT, len(items), kind))
        for seq, item in enumerate(items):
            word = "MISSION_REQUEST_INT"
            self.expect(word, 1.0, seq=seq, mission_type=kind)
            self.send(make(*ROBOT, seq, *item, kind))
        return self.expect("MISSION_ACK", within_s, mission_type=kind, type=0)

    def download(self, kind):
        """Return the items of a kind of plan, read as MISSION_ITEM_INT."""
        self.send(m.MAVLink_mission_request_list_message(*ROBOT, kind))
        count = self.expect("MISSION_COUNT", mission_type=kind).count
        items = []
        for seq in range(count):
            self.send(m.MAVLink_mission_request_int_message(*ROBOT, seq, kind))
            items.append(self.expect("MISSION_ITEM_INT", seq=seq, mission_type=kind))
        self.send(m.MAVLink_mission_ack_message(*ROBOT, 0, kind))
        return items
