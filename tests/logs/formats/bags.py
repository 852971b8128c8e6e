"""A drive through the room of `recorded_room`, written as ROS bags by rosbags itself."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robotctl.model.geometry.se2 import SE2
from tests.workbench.localise.recorded_room import BEAMS, driven, seen

KINDS = ("ros1", "sqlite", "mcap")
ODOM, TF, SCAN = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/LaserScan"
BEGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 500_000_000


@dataclass
class Laser:
    """Where a laser sits on the robot; upside down its beams run the other way."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw: float = 0.0
    upside_down: bool = False
    tilt: float = 0.0
    topic: str = "/scan"
    frame: str = "laser"


CENTRED = Laser()


@cache  # it compiles what writes each type of message
def typestore(is1):
    """Return the types of either ROS."""
    if not is1:
        return get_typestore(Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


class Bag:
    """Writes messages of either ROS, with the same calls."""

    def __init__(self, path, kind):
        self.is1 = kind == "ros1"
        self.store = typestore(self.is1)
        self.types = self.store.types
        if self.is1:
            self.writer = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(path, version=9, storage_plugin=plugin)
        self.connections = {}
        self.clock = self.log_clock = lambda _topic, stamp_ns: stamp_ns
        self.spoil = lambda _topic, _stamp_ns, _message: None
        self.writer.open()

    def write(self, topic, kind, message, stamp_ns):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        pack = self.store.serialize_ros1 if self.is1 else self.store.serialize_cdr
        self.spoil(topic, stamp_ns, message)
        log_ns = self.log_clock(topic, stamp_ns)
        self.writer.write(self.connections[topic], log_ns, pack(message, kind))

    def header(self, frame, stamp_ns, topic=""):
        stamp_ns = self.clock(topic, stamp_ns) if stamp_ns else 0
        time = self.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        kind = self.types["std_msgs/msg/Header"]
        return kind(0, time, frame) if self.is1 else kind(time, frame)

    def quaternion(self, roll, yaw):
        cr, sr, cy, sy = (
            f(0.5 * angle) for angle in (roll, yaw) for f in (math.cos, math.sin)
        )  # fmt: skip
        return self.types["geometry_msgs/msg/Quaternion"](sr * cy, sr * sy, cr * sy, cr * cy)

    def stamped(self, parent, child, stamp_ns, pose, z=0.0, roll=0.0, topic="/tf"):
        x, y, yaw = pose
        vector = self.types["geometry_msgs/msg/Vector3"](x, y, z)
        motion = self.types["geometry_msgs/msg/Transform"](vector, self.quaternion(roll, yaw))
        kind = self.types["geometry_msgs/msg/TransformStamped"]
        return kind(self.header(parent, stamp_ns, topic), child, motion)

    def transform(self, parent, child, stamp_ns, pose, z=0.0, roll=0.0, static=False, space=""):
        topic = space + ("/tf_static" if static else "/tf")
        message = self.types[TF]([self.stamped(parent, child, stamp_ns, pose, z, roll, topic)])
        self.write(topic, TF, message, stamp_ns)

    def odometry(self, topic, frame, child, stamp_ns, pose):
        x, y, yaw = pose
        types, none = self.types, np.zeros(36)
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        at = types["geometry_msgs/msg/Pose"](
            types["geometry_msgs/msg/Point"](x, y, 0.0), self.quaternion(0.0, yaw)
        )
        message = types[ODOM](
            self.header(frame, stamp_ns, topic), child,
            types["geometry_msgs/msg/PoseWithCovariance"](at, none),
            types["geometry_msgs/msg/TwistWithCovariance"](
                types["geometry_msgs/msg/Twist"](zero, zero), none
            ),
        )  # fmt: skip
        self.write(topic, ODOM, message, stamp_ns)

    def scan(self, laser, stamp_ns, ranges, log_ns=None, reach_m=30.0, stamped=True):
        message = self.types[SCAN](
            self.header(laser.frame, stamp_ns if stamped else 0, laser.topic),
            -0.5 * math.pi, 0.5 * math.pi, math.pi / (BEAMS - 1), 0.0, 0.5, 0.05, reach_m,
            np.array(ranges, np.float32), np.empty(0, np.float32),
        )  # fmt: skip
        self.write(laser.topic, SCAN, message, log_ns or stamp_ns)

    def close(self):
        self.writer.close()


def stamp(i):
    return BEGIN_NS + i * STEP_NS


def write_bag(path, kind, lasers=(CENTRED,), *, odometry=True, world="map", steps=60, seed=7,
              truth_topic="", reach_m=30.0, slash=False, stamped=True, begin=0, until=None,
              prefix="", space="", child=None, odom_topic="/odom", clock=None, log_clock=None,
              spoil=None, says=lambda _topic, _i: True, bag=None):  # fmt: skip
    """Write a drive, or its steps from one to another; return all its true poses (n, 3).

    Parameters
    ----------
    prefix, space
        What the names of frames, and of topics, begin with.
    child
        The child frame that odometry messages tell; None: the robot's.
    clock, log_clock
        What headers and the log make of a topic's true time [ns].
    spoil
        Changes a topic's message of a time.
    says
        Whether a topic has a message of a step.
    bag
        To write to, and to leave open.
    """
    rng = np.random.default_rng(seed)
    truth, odom = driven(steps)
    given, bag = bag, bag or Bag(path, kind)
    bag.clock, bag.log_clock = clock or bag.clock, log_clock or bag.log_clock
    bag.spoil = spoil or bag.spoil
    name = (("/{}" if slash else "{}").format(prefix) + "{}").format
    base = name("base_footprint")
    bag.transform(base, name("base_link"), stamp(0), (0, 0, 0), 0.1, static=True, space=space)
    for laser in lasers:
        mount = laser.x_m, laser.y_m, laser.yaw
        roll = math.pi * laser.upside_down + laser.tilt
        frames = name("base_link"), name(laser.frame)
        bag.transform(*frames, stamp(0), mount, 0.3, roll, static=True, space=space)
    lasers = [
        replace(laser, topic=space + laser.topic, frame=name(laser.frame)) for laser in lasers
    ]
    for i, (pose, at) in list(enumerate(zip(truth, odom, strict=True)))[begin:until]:
        if odometry and says(odom_topic, i):
            child_frame = base if child is None else child
            bag.odometry(space + odom_topic, name("odom"), child_frame, stamp(i), at)
        if says("/tf", i):
            bag.transform(name("odom"), base, stamp(i), at, space=space)
        if world and says("world", i):
            correction = SE2(*pose) @ SE2(*at).inverse()
            there = correction.x_m, correction.y_m, correction.theta_rad
            bag.transform(name(world), name("odom"), stamp(i), there, space=space)
        if truth_topic:
            bag.odometry(truth_topic, "world", "base_footprint", stamp(i), pose)
        for laser in lasers:
            x, y = SE2(*pose).apply(laser.x_m, laser.y_m)
            ranges = seen(x, y, pose[2] + laser.yaw)
            ranges = np.where(ranges < 80.0, ranges + 0.01 * rng.standard_normal(BEAMS), math.inf)
            if says(laser.topic, i):
                bag.scan(laser, stamp(i), ranges[::-1] if laser.upside_down else ranges,
                         reach_m=reach_m, stamped=stamped)  # fmt: skip
    if given is None:
        bag.close()
    return np.array(truth)
