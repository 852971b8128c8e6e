"""Places learnt and recognised from recordings, from states that are published, and simulated."""

import math
from itertools import chain, repeat

import msgspec
import numpy as np
import pytest
import zmq

from robotctl.app.supervision.running_robot import running
from robotctl.errors import ConfigError, LinkError, PlaceError
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.logs.formats.tum import Trajectory, write_tum
from robotctl.logs.mcap.log import McapLog
from robotctl.maps.place_file import load_book
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.clock import VirtualClock
from robotctl.runtime.flight.recorder import Recorder, RecordHeader
from robotctl.runtime.ipc.topics import Endpoints, Publisher, endpoint_directory
from robotctl.workbench.places.live import live_turn
from robotctl.workbench.places.options import PlaceSource
from robotctl.workbench.places.places import learn, marked, recognise
from tests.workbench.places.turning_robot import ROBOT, hallway, kitchen, turning


def quiet(_turned_rad):
    pass


def write_log(folder, states, truth=None):
    """Write a recording of ours: states, where the sonars sit, and the truth if there is one."""
    folder.mkdir(exist_ok=True)
    states = list(states)
    robot = msgspec.json.encode(ROBOT).decode()
    with (folder / "control-0001.rec").open("wb") as file:
        Recorder(file.write, RecordHeader("1", robot, 0.0, 0.0, 0.0))
    with (folder / "robot-0001.mcap").open("wb") as file:
        log = McapLog(file, 0, "rover")
        for state in states:
            log.add(state)
        log.close()
    if truth is not None:
        stamps = np.array([state.stamp_ns for state in states])
        poses = np.array([truth @ (s.x_m, s.y_m, s.theta_rad) for s in states])
        write_tum(folder / "truth-0001.tum", Trajectory(stamps, poses))
    return folder


class Shifted:
    """A frame that lies somewhere else, not turned: `Shifted(x, y) @ pose`."""

    def __init__(self, x, y):
        self.off = np.array([x, y, 0.0])

    def __matmul__(self, pose):
        return np.array(pose) + self.off


@pytest.fixture
def book(tmp_path):
    """Return the file of a book with the kitchen, learnt where the truth has x 3, y 4."""
    log = write_log(tmp_path / "kitchen", turning(kitchen), Shifted(3.0, 4.0))
    learn("kitchen", tmp_path / "book.toml", PlaceSource(log=log), quiet)
    return tmp_path / "book.toml"


def test_a_place_learnt_from_a_recording_has_the_pose_of_its_reference(book):
    (place,) = load_book(book).places
    assert place.in_world
    pose = place.visits[0].pose
    assert (pose.x_m, pose.y_m) == pytest.approx((3.0, 4.0), abs=1e-3)


def test_it_is_recognised_in_another_recording_turned_and_another_place_is_not(book, tmp_path):
    again = write_log(tmp_path / "again", turning(kitchen, heading=0.4, drift=1.3))
    (found,) = recognise(book, PlaceSource(log=again), quiet)
    place = found.recognition.found
    assert place is not None
    end = found.visited.turn.odometry.theta_rad + 1.3
    assert math.remainder(place.pose.theta_rad - end, math.tau) == pytest.approx(0.0, abs=0.06)
    assert found.visited.pose is None
    other = write_log(tmp_path / "other", turning(hallway))
    (found,) = recognise(book, PlaceSource(log=other), quiet)
    assert found.recognition.refusal.startswith("unknown")


def test_a_user_may_say_where_the_robot_stood_as_it_began(book, tmp_path):
    log = write_log(tmp_path / "hall", turning(hallway, heading=0.5))
    known = learn("hallway", book, PlaceSource(log=log, at="1,2,90"), quiet).book
    visit = known.places[1].visits[0]
    assert (visit.pose.x_m, visit.pose.y_m) == pytest.approx((1.0, 2.0))
    turned = math.remainder(visit.pose.theta_rad - math.pi / 2, math.tau)
    assert abs(turned) < 0.15


def test_two_turns_at_one_place_are_two_visits(tmp_path):
    states = chain(turning(kitchen), turning(kitchen, begin_ns=8 * 10**9, heading=1.2 * math.tau))
    log = write_log(tmp_path / "log", states)
    known = learn("kitchen", tmp_path / "b.toml", PlaceSource(log=log), quiet).book
    assert [len(place.visits) for place in known.places] == [2]
    assert not known.places[0].in_world


def test_turns_at_several_places_are_not_learnt_as_one(tmp_path):
    states = chain(turning(kitchen), turning(hallway, begin_ns=10**10, x_m=2.0))
    log = write_log(tmp_path / "log", states)
    with pytest.raises(PlaceError, match="several places"):
        learn("kitchen", tmp_path / "b.toml", PlaceSource(log=log), quiet)
    assert not (tmp_path / "b.toml").exists()


def test_less_than_a_turn_is_refused_with_how_far_it_went(tmp_path):
    log = write_log(tmp_path / "log", turning(kitchen, rounds=0.5))
    with pytest.raises(PlaceError, match=r"by 17\d deg at most, 360 deg are needed"):
        learn("kitchen", tmp_path / "b.toml", PlaceSource(log=log), quiet)


def test_what_is_not_learnt_leaves_the_file_as_it_was(book, tmp_path):
    before = book.read_bytes()
    log = write_log(tmp_path / "silent", turning(lambda _bearing: math.inf))
    with pytest.raises(PlaceError, match="desert is not learnt: the sonars received an echo in 0%"):
        learn("desert", book, PlaceSource(log=log), quiet)
    assert book.read_bytes() == before


class Published:
    """A robot that publishes a few of its states each time that somebody waits for it.

    It is the clock as well, whose time stands still.
    """

    def __init__(self, instance, states, localisation=None):
        self.context = zmq.Context()
        self.publisher = Publisher(
            self.context, Endpoints(endpoint_directory(instance)).control_state
        )
        self.states = iter(states)
        self.localisation = localisation

    def now_ns(self):
        return 0

    def sleep_until(self, _deadline_ns):
        if self.localisation is not None:
            self.publisher.send(self.localisation)
        for _, state in zip(range(10), self.states, strict=False):
            self.publisher.send(state)

    def turn(self, began=None, progress=quiet):
        try:
            return live_turn("rover", ROBOT, SignatureConfig(), began, progress, self)
        finally:
            self.context.destroy(linger=0)


@pytest.fixture
def sockets(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


FOREVER = 1e6
"""Rounds of a robot: until it is heard."""


@pytest.mark.usefixtures("sockets")
def test_a_running_robot_is_listened_to_and_its_localiser_says_where_it_ended(book):
    knows = LocalisationState(
        0, "mcl", LocalisationStatus.LOCALISED, 5.0, 1.0, 0.0, (0.0,) * 6
    )  # fmt: skip
    visited = Published("rover", turning(kitchen, rounds=FOREVER), knows).turn()
    assert (visited.pose.x_m, visited.pose.y_m) == pytest.approx((5.0, 1.0))
    assert load_book(book).suggest(visited.turn.signature).found.place == "kitchen"


@pytest.mark.usefixtures("sockets")
def test_a_running_robot_that_knows_no_place_can_be_told_where_it_stood():
    robot = Published("rover", turning(kitchen, rounds=FOREVER))
    visited = robot.turn(SE2(7.0, 8.0, 0.0))
    assert (visited.pose.x_m, visited.pose.y_m) == pytest.approx((7.0, 8.0))


@pytest.mark.usefixtures("sockets")
def test_where_a_running_robot_ended_may_be_known_to_nobody():
    lost = LocalisationState(0, "mcl", LocalisationStatus.LOST, 5.0, 1.0, 0.0, (0.0,) * 6)
    assert Published("rover", turning(kitchen, rounds=FOREVER), lost).turn().pose is None


@pytest.mark.usefixtures("sockets")
def test_a_robot_of_another_name_is_offered(book):
    robot = Published("rover", ())
    try:
        with pytest.raises(LinkError, match='no robot of that name runs; did you mean "rover"'):
            recognise(book, PlaceSource(live="rovr"), quiet)
    finally:
        robot.context.destroy(linger=0)
    with pytest.raises(LinkError, match="none runs"):
        running("rover")


@pytest.mark.usefixtures("sockets")
def test_looking_for_a_robot_makes_and_removes_no_folder(tmp_path):
    (tmp_path / "robotctl" / "ended").mkdir(parents=True)
    (tmp_path / "mine").mkdir()
    for name in ("rover", "ended", "../mine", ".."):
        with pytest.raises(LinkError):
            running(name)
    assert sorted(str(each.relative_to(tmp_path)) for each in tmp_path.rglob("*")) == [
        "mine", "robotctl", "robotctl/ended"
    ]  # fmt: skip


@pytest.mark.usefixtures("sockets")
def test_a_robot_that_falls_silent_is_not_waited_for():
    robot = Published("rover", ())
    clock = VirtualClock()
    try:
        with pytest.raises(PlaceError, match="no messages from the robot for 5 s"):
            live_turn("rover", ROBOT, SignatureConfig(), None, quiet, clock)
    finally:
        robot.context.destroy(linger=0)
    assert 5.0 < 1e-9 * clock.now_ns() < 5.1


@pytest.mark.usefixtures("sockets")
def test_a_robot_that_goes_on_speaking_is_waited_for():
    class Slow(Published):
        """When it was heard it takes another 4 s, twice."""

        time_ns, turned_rad = 0, 0.0

        def now_ns(self):
            return self.time_ns

        def hear(self, turned_rad):
            if turned_rad > self.turned_rad and self.time_ns < 8 * 10**9:
                self.turned_rad = turned_rad
                self.time_ns += 4 * 10**9

    # So slowly that what fits into the queues of the sockets is less than half a turn.
    robot = Slow("rover", turning(kitchen, rounds=FOREVER, step_rad=0.004))
    assert robot.turn(progress=robot.hear).turn.signature.echoes > 0.5
    assert robot.time_ns == 8 * 10**9


@pytest.mark.usefixtures("sockets")
def test_a_robot_with_other_sonars_than_its_file_is_refused():
    state = next(turning(kitchen))
    other = msgspec.structs.replace(state, sonar_m=(1.0,) * 3, sonar_stamp_ns=(1,) * 3)
    with pytest.raises(PlaceError, match="3 sonars, that of the file diff_drive 8"):
        Published("rover", repeat(other)).turn()


def test_the_simulated_robot_learns_and_recognises_a_place_of_the_office_turned(tmp_path):
    book = tmp_path / "book.toml"
    told = []
    learn("meeting_room", book, PlaceSource(world="office"), told.append)
    assert max(told) > 6.0
    (found,) = recognise(book, PlaceSource(world="office", at="14.02,4.47,100", seed=2), quiet)
    place = found.recognition.found
    assert place is not None
    assert math.degrees(place.rotation_rad) == pytest.approx(100.0, abs=3.0)
    truth = found.visited.pose
    assert math.remainder(place.pose.theta_rad - truth.theta_rad, math.tau) == pytest.approx(
        0.0, abs=0.05
    )
    assert math.hypot(place.pose.x_m - truth.x_m, place.pose.y_m - truth.y_m) < 0.05


def test_marks_of_a_world_are_found_by_name(tmp_path):
    office = tmp_path / "office.toml"
    pose = marked(office, "kitchen")
    assert (pose.x_m, pose.y_m) == (3.0, 13.2)
    with pytest.raises(ConfigError, match='nor a mark of office; did you mean "kitchen"'):
        marked(office, "kichen")
    with pytest.raises(ConfigError, match="elsewhere has no marks"):
        marked(tmp_path / "elsewhere.toml", "kitchen")


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ({}, "found none"),
        ({"world": "office", "live": "robot"}, "found --world and --live"),
    ],
)
def test_exactly_one_source_is_needed(source, says):
    with pytest.raises(ConfigError, match=says):
        PlaceSource(**source)


@pytest.mark.parametrize("at", ["1", "1,x", "1,2,3,4", "1,nan"])
def test_a_pose_that_is_none_is_refused(book, tmp_path, at):
    log = write_log(tmp_path / "log", turning(kitchen))
    with pytest.raises(ConfigError, match="needed is X,Y or X,Y,HEADING"):
        recognise(book, PlaceSource(log=log, at=at), quiet)


def test_a_robot_that_cannot_turn_on_the_spot_says_so(tmp_path):
    source = PlaceSource(world="office", robot="tricycle")
    with pytest.raises(PlaceError, match="tricycle has steering"):
        learn("kitchen", tmp_path / "b.toml", source, quiet)
