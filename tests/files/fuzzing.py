"""What `tools/fuzz.py` tries on the readers of files, and the inputs that it has found.

An input tells changes of a small valid file (`edits`). Bags and logs are also tried with changes in
their messages, packed again as their writers do, so that no checksum keeps them from the readers.
A corpus is a text file, an input in hexadecimal on each line.
"""

from __future__ import annotations

import functools
import io
import itertools
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from firmware_sim.config.config import load_robot as load_simulated_robot
from firmware_sim.errors import SimulationError
from firmware_sim.world.world import load_world
from robotctl.app.processes.navigator import load_mission
from robotctl.config.robot_file import load_robot
from robotctl.errors import RobotctlError
from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.signatures import Signature, SignatureConfig
from robotctl.logs.formats.image_folder import timed_images
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.robotctl_log import is_mcap
from robotctl.logs.formats.tum import read_tum
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.recovery import recover
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.maps.place_file import load_book, save_book
from robotctl.maps.topology_file import load_topology
from robotctl.maps.world import load_walls
from robotctl.messages.control import Notice
from robotctl.messages.estimation import CameraView, LidarScan, LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.toml_source import load
from robotctl.workbench.places.places import Marks
from tests.files.edits import LONGEST, edited
from tests.logs.formats.bags import Bag
from tests.mavlink.conftest import CONTROL

__all__ = ["CORPUS", "LONGEST", "TARGETS", "corpus"]

CORPUS = Path(__file__).parent / "corpus"
CONFIGS = Path(__file__).parents[2] / "configs"
SECOND = 10**9
EPOCH_NS = 1_700_000_000 * SECOND
COVARIANCE = (0.01, 0.0, 0.0, 0.01, 0.0, 0.01)

tried_bytes = 0
"""Bytes of changed files so far."""


def attempt(read: Callable[[], object]) -> None:
    """Do what a command does; only the errors may come that it turns into sentences."""
    try:
        read()
    except (RobotctlError, SimulationError):
        pass
    except OSError as error:
        if error.filename is None:
            raise


def on_file(name: str, files: Sequence[bytes], read: Callable[[Path], object], data: bytes) -> None:
    """Read a changed file of a name."""
    global tried_bytes  # noqa: PLW0603 - of a process that does nothing else
    content = edited(data, files)
    tried_bytes += len(content)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        attempt(lambda: read(path))


# Recordings


def drive(path: Path) -> None:
    """Read a recorded drive; what is read of it must hang together."""
    check(read_recording(path))


def check(recording: Recording) -> None:
    """Assert what every recording promises, whatever was in its file."""
    known = recording.odometry
    for each in (known, recording.reference, recording.believed):
        if each is not None:
            assert np.isfinite(each.poses).all()
            assert (np.diff(each.stamps_ns) >= 0).all()
    stamps_ns = [entry.scan.stamp_ns for entry in recording.scans]
    assert stamps_ns == sorted(stamps_ns)
    for entry in itertools.chain(recording.scans, recording.views):
        assert np.isfinite(entry.scan.points_base()).all()
    for sonar in recording.sonars:
        assert known is not None
        assert known.at(sonar.reading.stamp_ns) == sonar.odometry
    assert np.isfinite(recording.twists).all()


def small_bag(kind: str) -> bytes:
    """Return a bag of four poses and scans, and what of it is read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "drive.bag" if kind == "ros1" else "drive")
        bag = Bag(path, kind)
        bag.transform("base_link", "laser", EPOCH_NS, (0.2, 0.0, 0.1), static=True)
        for step in range(4):
            at_ns, pose = EPOCH_NS + step * SECOND // 5, (0.1 * step, 0.0, 0.1)
            bag.odometry("/odom", "odom", "base_link", at_ns, pose)
            bag.transform("odom", "base_link", at_ns, pose)
            bag.transform("map", "odom", at_ns, (0.0, 0.01 * step, 0.0))
            message = bag.types["sensor_msgs/msg/LaserScan"](
                bag.header("laser", at_ns), -0.5, 0.5, 0.1, 0.0, 0.1, 0.05, 10.0,
                np.full(8, 2.0, np.float32), np.empty(0, np.float32),
            )  # fmt: skip
            bag.write("/scan", "sensor_msgs/msg/LaserScan", message, at_ns)
        bag.close()
        if not path.is_dir():
            return path.read_bytes()
        (file,) = [*path.glob("*.db3"), *path.glob("*.mcap")]
        return file.read_bytes()


def repacked(content: bytes, compression: CompressionType, *, crcs: bool) -> bytes:
    """Return an MCAP file anew, as the library of all programs but ours writes it."""
    reader = make_reader(io.BytesIO(content))
    file = io.BytesIO()
    writer = Writer(file, compression=compression, enable_crcs=crcs, enable_data_crcs=crcs)
    header = reader.get_header()
    writer.start(header.profile, header.library)
    channels: dict[int, int] = {}
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        if channel.id not in channels:
            number = (
                0
                if schema is None
                else writer.register_schema(schema.name, schema.encoding, schema.data)
            )
            channels[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, number, channel.metadata
            )
        writer.add_message(
            channels[channel.id], message.log_time, message.data, message.publish_time
        )
    writer.finish()
    return file.getvalue()


def own_log() -> bytes:
    """Return a log of ours with a message of each topic that drives are read from."""
    file = io.BytesIO()
    log = McapLog(file, EPOCH_NS, "rover")
    ranges = np.full(8, 2.0, "<f4").tobytes()
    for step in range(4):
        at_ns = step * SECOND // 5
        state = msgspec.structs.replace(
            CONTROL, stamp_ns=at_ns, x_m=0.1 * step, sonar_m=(1.0,), sonar_stamp_ns=(at_ns,)
        )
        log.add(state)
        log.add(LidarScan(at_ns, 0.1, 0.0, -0.5, 0.1, 10.0, ranges))
        log.add(
            LocalisationState(at_ns, "mcl", LocalisationStatus.LOCALISED, 0.1, 0.2, 0.0, COVARIANCE)
        )
        log.add(CameraView(at_ns, 0.1, 0.0, 3.0, (0.0,), (1.0,), (0.1,), (0.5,)))
        log.add(Notice(at_ns, 6, "on"))
    log.close()
    return file.getvalue()


def with_messages(content: bytes, data: bytes) -> bytes:
    """Return an MCAP file with changes in its messages, and right checksums.

    The messages are changed as one text, in which each has its topic, time and length before it.
    """
    reader = make_reader(io.BytesIO(content))
    entries = list(reader.iter_messages(log_time_order=False))
    known = {channel.topic: (schema, channel) for schema, channel, _ in entries}
    topics = sorted(known)
    blob = b"".join(
        bytes([topics.index(channel.topic)])
        + message.log_time.to_bytes(8, "little")
        + len(message.data).to_bytes(2, "little")
        + message.data
        for _, channel, message in entries
    )
    blob = edited(data, [blob])
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    header = reader.get_header()
    writer.start(header.profile, header.library)
    channels = {}
    for topic, (schema, channel) in known.items():
        number = writer.register_schema(schema.name, schema.encoding, schema.data)  # type: ignore[union-attr]
        channels[topic] = writer.register_channel(topic, channel.message_encoding, number)
    while len(blob) >= 11:
        topic, log_ns = topics[blob[0] % len(topics)], int.from_bytes(blob[1:9], "little")
        size = int.from_bytes(blob[9:11], "little")
        writer.add_message(channels[topic], log_ns, blob[11 : 11 + size], log_ns)
        blob = blob[11 + size :]
    writer.finish()
    return file.getvalue()


def messages_of(make: Callable[[], bytes]) -> Callable[[bytes], None]:
    """Return a target that changes the messages of an MCAP file."""
    return lambda data: on_file("drive.mcap", [with_messages(make(), data)], drive, b"")


def recovered(path: Path) -> None:
    """Recover a log: its bytes must be there after that, and no message that is read be new."""
    before = path.read_bytes()
    try:
        recover(path)
    finally:
        if not is_mcap(path) or path.read_bytes() == before:
            assert before in [each.read_bytes() for each in path.parent.iterdir()]
    left_out = [each for each in path.parent.iterdir() if each != path]
    assert [each.read_bytes() for each in left_out] in ([], [before])
    make_reader(io.BytesIO(path.read_bytes()), validate_crcs=True).get_summary()


CARMEN = (
    b"PARAM robot_frontlaser_offset 0.1 host 0\n"
    + b"".join(
        b"ODOM %.1f 0 0.1 0.2 0 0 %.1f host 0\n"
        b"FLASER 4 1.0 2.0 81.91 3.0 %.1f 0 0 %.1f 0 0 %.1f h 0\n"
        % (0.1 * i, 100 + 0.5 * i, 0.1 * i, 0.11 * i, 100.1 + 0.5 * i)
        for i in range(50)
    )
    + b"ROBOTLASER1 0 -1.57 3.14 0.01 80 0 0 2 1.0 2.0 0 0 0 0 0 0 0 0 0 0 0 0 140 host 0\n"
)
LEGO = (
    b"".join(
        b"M %d %d 0 0 0 %d 0\nS %d 4 100 200 300 400\nP %d 1000 2000\n"
        % (100 * i, 50 * i, 60 * i, 100 * i + 10, 100 * i)
        for i in range(50)
    )
    + b"L C 1000 2000 50\n"
)
TUM = b"# t x y z qx qy qz qw\n" + b"".join(
    b"%d.5 %.1f 0 0 0 0 0.0998 0.995\n" % (1_700_000_000 + i, 0.1 * i) for i in range(50)
)


def mrclam(data: bytes) -> None:
    """Read a folder of which one file is changed, by the first byte."""
    files = {
        "Barcodes.dat": b"6 60\n1 5\n",
        "Landmark_Groundtruth.dat": b"# s x y\n6 1 2 0 0\n",
        "Robot1_Odometry.dat": b"".join(b"%.1f 0.2 0.0\n" % (100 + 0.5 * i) for i in range(100)),
        "Robot1_Measurement.dat": b"100.6 60 1.5 0.1\n101 5 1 0\n" * 40,
        "Robot1_Groundtruth.dat": b"".join(b"%d %d 0 0\n" % (100 + i, i) for i in range(50)),
    }
    name = sorted(files)[data[0] % len(files)] if data else "Barcodes.dat"
    with tempfile.TemporaryDirectory() as folder:
        for each, content in files.items():
            Path(folder, each).write_bytes(content)
        on_file(name, [files[name]], lambda path: _beside(Path(folder), path), data)


def _beside(folder: Path, path: Path) -> None:
    path.replace(folder / path.name)
    try:
        drive(folder)
    finally:
        (folder / path.name).replace(path)


def images(path: Path) -> None:
    """Read a list of images in whose folder these are."""
    for name in ("1.png", "2.png"):
        (path.parent / name).touch()
    timed_images(path.parent)


# Maps and settings

PGM = (
    b"P5\n# made\n75 80\n255\n" + bytes([254, 254, 0, 205, 254, 254] * 1000),
    b"P2 3 2 255\n0 254 205\n254 0 254\n",
    b"P5\n4 3\n65535\n" + bytes([255, 254, 0, 0, 128, 7, 255, 255] * 3),
)
YAML = (
    b"image: room.pgm\nresolution: 0.05\norigin: [-0.5, -0.5, 0.1]\nnegate: 0\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
)


TOPOLOGY = b"""\
version = 2
[[place]]
name = "lounge"
kind = "room"
passages = ["door"]
area_m2 = 20.0
width_m = 4.0
depth_m = [2.0, 2.0, 2.0, 2.0]
x_m = 2.0
y_m = 2.5
[[place.exit]]
passage = "door"
bearing_deg = 0.0
distance_m = 2.0
heading_deg = 0.0
[[place]]
name = "kitchen"
kind = "room"
passages = ["door"]
area_m2 = 9.0
width_m = 3.0
depth_m = [1.5, 1.5, 1.5, 1.5]
[[passage]]
name = "door"
between = ["lounge", "kitchen"]
width_m = 0.9
length_m = 0.2
"""


def image(path: Path) -> None:
    """Read a map whose image is changed."""
    path.with_suffix(".yaml").write_bytes(YAML)
    ros_map(path.with_suffix(".yaml"))


def ros_map(path: Path) -> None:
    """Read a map, for localisers and as a world of the simulator."""
    pgm = path.with_name("room.pgm")
    if not pgm.exists():
        pgm.write_bytes(PGM[0])
    attempt(lambda: load_localisation_map(str(path), Path()))
    load_world(path)


def robot(path: Path) -> None:
    """Read a robot's file, as the controller and as the simulator do."""
    attempt(lambda: load_robot(path))
    load_simulated_robot(path)


def world(path: Path) -> None:
    """Read a world, as the controller and as the simulator do."""
    attempt(lambda: load_walls(path))
    load_world(path)


def _configs(*names: str) -> list[bytes]:
    return [(CONFIGS / name).read_bytes() for name in names]


@functools.cache
def _small_bag(kind: str) -> bytes:
    return small_bag(kind)


@functools.cache
def _mcap_files() -> list[bytes]:
    bag, own = _small_bag("mcap"), own_log()
    return [
        repacked(bag, CompressionType.NONE, crcs=False),
        repacked(bag, CompressionType.ZSTD, crcs=True),
        repacked(own, CompressionType.LZ4, crcs=False),
        own,
    ]


@functools.cache
def _book() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "book.toml")
        book = PlaceBook(signatures=SignatureConfig(bearings=24, max_range_m=3.5))
        for name in ("kitchen", "hall"):
            depth = np.linspace(1.0, 3.0 + 0.1 * len(name), 24)
            book = book.learned(name, Signature(depth, np.zeros(24)), SE2(1.0, len(name), 0.5))
        save_book(path, book)
        return path.read_bytes()


TARGETS: dict[str, Callable[[bytes], None]] = {
    "bag": lambda data: on_file("drive.bag", [_small_bag("ros1")], drive, data),
    "db3": lambda data: on_file("drive.db3", [_small_bag("sqlite")], drive, data),
    "mcap": lambda data: on_file("drive.mcap", _mcap_files(), drive, data),
    "bag-messages": messages_of(lambda: _small_bag("mcap")),
    "own-messages": messages_of(own_log),
    "recover": lambda data: on_file("drive.mcap", _mcap_files(), recovered, data),
    "carmen": lambda data: on_file("drive.log", [CARMEN], drive, data),
    "lego": lambda data: on_file("drive.txt", [LEGO], drive, data),
    "mrclam": mrclam,
    "tum": lambda data: on_file("drive.tum", [TUM], read_tum, data),
    "images": lambda data: on_file(
        "data.csv", [b"#time,name\n1700000000000000000,1.png\n1700000001000000000,2.png\n"],
        images, data,
    ),
    "pgm": lambda data: on_file("room.pgm", PGM, image, data),
    "map": lambda data: on_file("room.yaml", [YAML], ros_map, data),
    "robot": lambda data: on_file(
        "robot.toml", _configs("diff_drive.toml", "ackermann.toml"), robot, data
    ),
    "world": lambda data: on_file(
        "world.toml", _configs("worlds/clutter.toml", "worlds/flat.toml"), world, data
    ),
    "mission": lambda data: on_file(
        "mission.toml", _configs("missions/patrol.toml", "missions/errand.toml"), load_mission, data
    ),
    "places": lambda data: on_file("book.toml", [_book()], load_book, data),
    "topology": lambda data: on_file("places.toml", [TOPOLOGY], load_topology, data),
    "marks": lambda data: on_file(
        "marks.toml", _configs("places/office.toml"), lambda path: load(path, Marks), data
    ),
}  # fmt: skip


def corpus(target: str) -> list[bytes]:
    """Return the inputs kept for a target."""
    file = CORPUS / f"{target}.txt"
    lines = file.read_text(encoding="ascii").splitlines() if file.exists() else []
    return [bytes.fromhex(line) for line in lines]
