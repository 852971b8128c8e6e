"""The estimators of the navigation process on hand-made messages."""

from __future__ import annotations

import errno
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from robotctl.app.localisation.estimators import Estimators, make_estimators
from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.app.localisation.localiser import (
    LocaliserInput,
    external_covariance,
)
from robotctl.app.localisation.mapper import Mapper
from robotctl.app.localisation.mcl_localiser import pose_measurement
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.kalman.ekf import checked_covariance
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.localisers import LOCALISERS
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.ranging.scan_messages import camera_scan, lidar_scan
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.messages.control import ControlState, ExternalPose
from robotctl.messages.estimation import CameraView, LidarScan, LocalisationState
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import upper_triangle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED
from robotctl.model.wall_map import WallMap
from tests.messages.test_world_pose import STATE

MS = 1_000_000
ROOM = np.array(
    [[0.0, 0.0, 6.0, 0.0], [6.0, 0.0, 6.0, 4.0], [6.0, 4.0, 0.0, 4.0], [0.0, 4.0, 0.0, 0.0],
     [2.0, 4.0, 2.0, 3.0], [4.5, 0.0, 4.5, 1.0]]
)  # fmt: skip
WORLD = """
[world]
name = "room"
start = { x_m = 1.0, y_m = 1.0 }
"""


def control(stamp_ns: int, pose: SE2, **changes: object) -> ControlState:
    return msgspec.structs.replace(
        STATE, stamp_ns=stamp_ns, x_m=pose.x_m, y_m=pose.y_m, theta_rad=pose.theta_rad, **changes
    )


def scan(stamp_ns: int, pose: SE2, walls: np.ndarray = ROOM, beams: int = 180) -> LidarScan:
    """Return what a lidar at `base` sees, by intersecting each ray with each wall."""
    step = math.tau / beams
    angles = pose.theta_rad - math.pi + step * np.arange(beams)
    ux, uy = np.cos(angles)[:, None], np.sin(angles)[:, None]
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    dx, dy = walls[:, 0] - pose.x_m, walls[:, 1] - pose.y_m
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (dx * ey - dy * ex) / (ux * ey - uy * ex)
        share = (dx * uy - dy * ux) / (ux * ey - uy * ex)
    ranges = np.where((along > 0) & (share >= 0) & (share <= 1), along, np.inf).min(axis=1)
    return LidarScan(stamp_ns, 0.0, 0.0, -math.pi, step, 12.0, ranges.astype("<f4").tobytes())


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a room of 6 by 4 m with two stubs of walls."""
    walls = "".join(f"[[wall]]\npoints = [[{ax}, {ay}], [{bx}, {by}]]\n" for ax, ay, bx, by in ROOM)
    path = tmp_path_factory.mktemp("world") / "room.toml"
    path.write_text(WORLD + walls)
    return path


def estimators(world: Path, *settings: str) -> Estimators:
    config = load_robot(
        find_file("diff_drive"), (f'localisation.map="{world}"', "sonar=[]", *settings)
    )
    return make_estimators(config, SE2(1.0, 1.0, 0.0), world.parent)


def way(stamp_ns: int) -> SE2:
    """Drive 0.4 m/s along x from (1, 1)."""
    return SE2(1.0 + 0.4 * stamp_ns * 1e-9, 1.0, 0.0)


def pose_in_world(state: ControlState, found: LocalisationState) -> SE2:
    assert found.odom_epoch_ns == state.odom_epoch_ns
    return found.T_world_odom @ state.T_odom_base


def distance(a: SE2, b: SE2) -> float:
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)


def test_a_scan_counts_where_the_robot_was_when_it_was_taken(world: Path) -> None:
    late_ns = 400 * MS
    several = estimators(world, 'localisation.method="mcl"')
    for step in range(80):
        now_ns = 50 * MS * step
        state = control(now_ns, way(now_ns))
        seen = [scan(now_ns - late_ns, way(now_ns - late_ns))] if now_ns > late_ns else []
        found = several.step(state, seen, (), now_ns)
    # 0.4 s late at 0.4 m/s: taken for now, each scan would say that the robot is 0.16 m behind.
    assert distance(pose_in_world(state, found), way(now_ns)) < 0.04
    assert found.status is LocalisationStatus.LOCALISED


def test_the_odometrys_frame_is_found_wherever_it_lies(world: Path) -> None:
    several = estimators(
        world, 'localisation.method="mcl"', 'localisation.start="unknown"', "localisation.seed=3"
    )
    T_odom_world = SE2(-7.0, 3.0, 2.0)
    for step in range(160):
        now_ns = 50 * MS * step
        state = control(now_ns, T_odom_world @ way(now_ns))
        found = several.step(state, [scan(now_ns, way(now_ns))], (), now_ns)
    assert found.status is LocalisationStatus.LOCALISED
    assert distance(pose_in_world(state, found), way(now_ns)) < 0.05
    inverse = T_odom_world.inverse()
    assert (found.x_m, found.y_m) == pytest.approx((inverse.x_m, inverse.y_m), abs=0.3)


@pytest.mark.parametrize("method", ["ekf", "mcl", "slam"])
@pytest.mark.parametrize("T_new_old", [SE2(5.0, -3.0, 2.0), SE2(-0.5, 0.0, 0.0)])
def test_another_odometry_is_no_motion(world: Path, method: str, T_new_old: SE2) -> None:
    """The control process has started again: its odometry says another pose, the robot stands."""
    several = estimators(world, f'localisation.method="{method}"')
    here = way(0)
    before = several.step(control(0, here, odom_epoch_ns=1), (), (), 0)
    stood = several.step(control(50 * MS, here, odom_epoch_ns=1), (), (), 50 * MS)
    assert stood.epoch_ns == before.epoch_ns
    for step in range(2, 20):
        state = control(50 * MS * step, T_new_old @ here, odom_epoch_ns=90 * MS)
        found = several.step(state, (), (), state.stamp_ns)
        assert (found.odom_epoch_ns, found.epoch_ns) == (90 * MS, 100 * MS)
        assert distance(pose_in_world(state, found), here) < 0.1


@pytest.mark.parametrize("method", ["ekf", "mcl"])
def test_a_pose_from_outside_corrects(world: Path, method: str) -> None:
    several = estimators(world, f'localisation.method="{method}"', "localisation.start_sigma_m=0.5")
    true = SE2(1.5, 1.2, 0.1)
    for step in range(100):
        now_ns = 50 * MS * step
        state = control(now_ns, way(now_ns))
        there = true @ SE2(1.0, 1.0, 0.0).inverse() @ way(now_ns)
        there = SE2(there.x_m, there.y_m, there.theta_rad)
        outside = ExternalPose(now_ns, there.x_m, there.y_m, there.theta_rad)
        found = several.step(state, (), (outside,), now_ns)
    assert distance(pose_in_world(state, found), there) < 0.1


@pytest.mark.parametrize(
    "bad",
    [
        {"ranges": b"\x00\x00\x80"},
        {"ranges": np.array([-1.0, 2.0], "<f4").tobytes()},
        {"first_rad": math.nan},
        {"max_range_m": math.inf},
        {"max_range_m": 0.0},
        {"x_m": math.nan},
    ],
)
def test_what_is_no_scan_is_left_out_and_said_once(world: Path, bad: dict[str, object]) -> None:
    several = estimators(world, 'localisation.method="mcl"', "localisation.mapping=true")
    news = []
    for step in range(5):
        now_ns = 50 * MS * step
        wrong = msgspec.structs.replace(scan(now_ns, way(now_ns)), **bad)
        several.step(control(now_ns, way(now_ns)), [wrong], (), now_ns)
        news += several.take_notices()
    assert several.rejected == 5
    assert sum("no scan" in line for line in news) == 1
    assert several.mapper is not None
    assert several.mapper.pictures(0) == []


def test_scans_from_before_the_odometry_is_known_are_left_out(world: Path) -> None:
    several = estimators(world, 'localisation.method="mcl"')
    now_ns = 10_000 * MS
    old = scan(1, SE2(5.0, 3.0, 1.0))
    for _ in range(10):
        now_ns += 50 * MS
        found = several.step(control(now_ns, SE2(1.0, 1.0, 0.0)), [old], (), now_ns)
    assert (found.x_m, found.y_m) == pytest.approx((0.0, 0.0), abs=0.02)


@pytest.mark.parametrize("off_s", [3600.0, 0.001, -2.1, -3600.0])
@pytest.mark.parametrize("sensor", ["lidar", "camera", "outside"])
def test_what_is_stamped_by_another_clock_is_left_out_and_said_once(
    world: Path, sensor: str, off_s: float
) -> None:
    several = estimators(world, 'localisation.method="mcl"')
    news = []
    for step in range(80):
        now_ns = 10_000 * MS + 50 * MS * step
        where, stamp_ns = way(50 * MS * step), now_ns + round(off_s * 1e9)
        wrong: list[LidarScan | CameraView] = []
        poses: list[ExternalPose] = []
        if step % 20 == 10 and sensor == "lidar":
            wrong = [scan(stamp_ns, SE2(3.0, 2.0, 1.0))]
        elif step % 20 == 10 and sensor == "camera":
            wrong = [view(stamp_ns, 0.5, 0.01)]
        elif step % 20 == 10:
            poses = [ExternalPose(stamp_ns, 3.0, 2.0, 1.0)]
        found = several.step(control(now_ns, where), [scan(now_ns, where), *wrong], poses, now_ns)
        news += several.take_notices()
    assert found.status is LocalisationStatus.LOCALISED
    assert distance(pose_in_world(control(now_ns, where), found), where) < 0.05
    assert several.untimely == 4
    (said,) = [line for line in news if "is left out" in line]
    assert ("ahead of its time" in said) == (off_s > 0.0)


def test_particles_never_stand_at_a_time_that_the_odometry_has_not_reached(world: Path) -> None:
    """The odometry falls short by a tenth: particles that stand still would not find out."""
    several = estimators(world, 'localisation.method="mcl"')
    assert several.localiser is not None
    several.step(control(10**9, way(0)), (), (), 10**9)
    ahead = LocaliserInput({"lidar": [lidar_scan(scan(3600 * 10**9, way(0)))]})
    several.localiser.step(control(10**9, way(0)), ahead, 10**9)
    for step in range(1, 80):
        driven_ns, now_ns = 50 * MS * step, 10**9 + 50 * MS * step
        state, true = control(now_ns, way(9 * driven_ns // 10)), way(driven_ns)
        found = several.step(state, [scan(now_ns, true)], (), now_ns)
    assert distance(pose_in_world(state, found), true) < 0.05


def test_news_are_told_once(world: Path) -> None:
    several = estimators(world, 'localisation.method="mcl"')
    said = []
    for step in range(20):
        now_ns = 50 * MS * step
        several.step(control(now_ns, way(now_ns)), [scan(now_ns, way(now_ns))], (), now_ns)
        said += several.take_notices()
    assert said == ["the robot knows where it is"]


def test_particles_are_shown_twice_a_second_and_not_too_many(world: Path) -> None:
    several = estimators(world, 'localisation.method="mcl"')
    shown = [several.pictures(50 * MS * step) for step in range(1, 61)]
    clouds = [picture for pictures in shown for picture in pictures]
    assert len(clouds) == 6
    poses = np.frombuffer(clouds[-1].poses, "<f4").reshape(-1, 3)
    assert 100 < len(poses) <= 300
    assert np.median(poses[:, :2], axis=0) == pytest.approx((1.0, 1.0), abs=0.1)


def test_the_map_that_is_given_is_told_every_ten_seconds(world: Path) -> None:
    several = estimators(world, 'localisation.method="mcl"')
    told = [(s, given) for s in range(25) for given in several.given_map(s * 1000 * MS)]
    assert [second for second, _ in told] == [0, 10, 20]
    chart = told[-1][1].map
    cells = np.frombuffer(chart.cells, np.int8).reshape(chart.rows, chart.columns)
    assert {FREE, OCCUPIED} <= set(np.unique(cells))
    drawing = estimators(world, "localisation.mapping=true")
    assert drawing.given_map(0) == []


def test_a_robot_that_does_not_know_its_place_draws_nothing() -> None:
    history = OdometryHistory()
    mapper = Mapper(OccupancyGrid(), SensedRobot((), LocalisationConfig()), history)
    history.add(0, SE2())
    searching = LocalisationState(0, "mcl", LocalisationStatus.SEARCHING, 0.0, 0.0, 0.0, (0.0,) * 6)
    seen = LocaliserInput({"lidar": [lidar_scan(scan(0, SE2(1.0, 1.0, 0.0)))]})
    mapper.step(searching, seen)
    assert mapper.pictures(0) == []
    mapper.step(msgspec.structs.replace(searching, status=LocalisationStatus.LOCALISED), seen)
    assert len(mapper.pictures(0)) == 1


def view(
    stamp_ns: int, range_m: float, sigma_m: float, trouble: str = "", bearing_rad: float = 0.0
) -> CameraView:
    """Return what a camera at `base` sees of a wall across its line of sight."""
    beams = np.linspace(0.4, -0.4, 41)
    angles, ranges = (
        tuple((bearing_rad + beams).tolist()),
        tuple((range_m / np.cos(beams)).tolist()),
    )
    sigmas = (sigma_m,) * len(beams)
    beams_seen = (angles, ranges, sigmas, (0.3,) * len(beams))
    return CameraView(stamp_ns, 0.0, 0.0, 4.0, *beams_seen, trouble=trouble)


@pytest.mark.parametrize(("sigma_m", "drawn"), [(0.02, True), (0.2, False)])
def test_the_camera_draws_what_it_is_sure_of(sigma_m: float, drawn: bool) -> None:
    history = OdometryHistory()
    history.add(0, SE2(1.0, 1.0, 0.0))
    mapper = Mapper(OccupancyGrid(), SensedRobot((), LocalisationConfig()), history)
    mapper.step(None, LocaliserInput({"camera": [camera_scan(view(0, 1.5, sigma_m))]}))
    grid = mapper.grid.to_map(0.6)
    walls = grid.centre_of(np.argwhere(grid.occupied()))
    assert bool(len(walls)) is drawn
    assert np.all(np.abs(walls[:, 0] - 2.5) < 0.1)


def test_particles_go_by_what_the_camera_sees_but_not_by_pictures_that_it_does_not_trust(
    world: Path,
) -> None:
    settings = ('localisation.method="mcl"', 'localisation.sensors=["camera"]')
    found = {}
    for trouble in ("", "glare"):
        several = estimators(world, *settings)
        for step in range(60):
            now_ns = 50 * MS * step
            here = SE2(1.0 + 0.01 * step, 1.0, 0.0)
            # The wall behind, at x 0: x is 0.15 m less than the robot was told.
            behind = view(now_ns, here.x_m - 0.15, 0.02, trouble, bearing_rad=math.pi)
            found[trouble] = several.step(control(now_ns, here), [behind], (), now_ns)
    assert found[""].x_m == pytest.approx(-0.15, abs=0.06)
    assert found["glare"].x_m == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((), np.diag([0.01, 0.01, 0.01])),
        ((4.0, 1.0, 0.0, 9.0, 0.0, 1.0), [[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 1.0]]),
        ((4.0, 90.0, 0.0, 9.0, 0.0, 1.0), np.diag([4.0, 9.0, 1.0])),
    ],
)
def test_a_covariance_from_outside_is_used_as_far_as_it_is_one(given, expected) -> None:
    found = external_covariance(ExternalPose(0, 0.0, 0.0, 0.0, given), LocalisationConfig())
    assert found == pytest.approx(np.array(expected))


def correlated(rng: np.random.Generator) -> tuple[float, ...]:
    """Return a covariance as it may come: 32 bit floats of any size, mostly fully correlated."""
    sigmas = 10.0 ** rng.uniform(-20.0, 19.0, 3)
    if rng.random() < 0.5:
        sigmas = rng.choice([1e-6, 0.1, 0.1, 1.0, 1e3], 3)
    signs = rng.choice([-1.0, 1.0], 3)
    several = rng.standard_normal((3, rng.integers(1, 4)))
    several /= np.linalg.norm(several, axis=1)[:, None]
    correlation = several @ several.T if rng.random() < 0.5 else np.outer(signs, signs)
    if rng.random() < 0.3:
        correlation[0, 1] *= 1.0 + rng.choice([-1e-3, -1e-7, 1e-9, 1e-3, 1e9])
    with np.errstate(under="ignore", over="ignore"):
        matrix = (correlation * np.outer(sigmas, sigmas)).astype(np.float32)
    variances = np.clip(np.diag(matrix), np.finfo(np.float32).smallest_subnormal, None)
    np.fill_diagonal(matrix, variances)
    return tuple(np.where(np.isfinite(matrix), matrix, 0.0)[np.triu_indices(3)].tolist())


def test_any_covariance_from_outside_can_be_inverted_and_says_less_the_farther_off() -> None:
    rng = np.random.default_rng(7)
    for _ in range(5000):
        pose = ExternalPose(0, 1.0, 2.0, 0.5, correlated(rng))
        covariance = external_covariance(pose, LocalisationConfig())
        checked_covariance(covariance)  # what the EKF demands
        off = rng.standard_normal((20, 3)) * 10.0 ** rng.uniform(-3.0, 3.0, (20, 1))
        off[:, 2] = np.clip(off[:, 2], -1.0, 1.0)
        here = np.array([pose.x_m, pose.y_m, pose.theta_rad])
        logs = pose_measurement(pose, LocalisationConfig())(np.vstack([here + off, here]))
        assert np.all(np.isfinite(logs)), pose
        assert np.all(logs[:-1] < 0.0), pose
        assert logs[-1] == 0.0
        largest = np.linalg.eigvalsh(covariance)[-1]
        at_least = -0.5 * np.sum(off**2, axis=1) / largest
        assert np.all(logs[:-1] <= 0.999 * at_least), pose


def test_a_covariance_that_is_sound_is_taken_as_it_is() -> None:
    rng = np.random.default_rng(8)
    for _ in range(200):
        root = rng.standard_normal((3, 5))
        matrix = root @ root.T
        pose = ExternalPose(0, 1.0, 2.0, 0.0, upper_triangle(matrix))
        assert external_covariance(pose, LocalisationConfig()) == pytest.approx(matrix, rel=1e-12)
        off = 0.1 * rng.standard_normal((4, 3))
        expected = [-0.5 * each @ np.linalg.solve(matrix, each) for each in off]
        log_likelihood = pose_measurement(pose, LocalisationConfig())
        assert log_likelihood(off + np.array([1.0, 2.0, 0.0])) == pytest.approx(expected)


@pytest.mark.parametrize("method", ["ekf", "mcl"])
def test_no_covariance_from_outside_ends_a_localiser(world: Path, method: str) -> None:
    rng = np.random.default_rng(9)
    several = estimators(world, f'localisation.method="{method}"')
    for step in range(200):
        now_ns = 50 * MS * step
        here = way(now_ns)
        poses = [ExternalPose(now_ns, here.x_m, here.y_m, 0.0, correlated(rng)) for _ in range(3)]
        found = several.step(control(now_ns, here), (), poses, now_ns)
        assert np.all(np.isfinite(found.covariance))


def test_a_map_may_lie_beside_the_robots_file(world: Path, monkeypatch) -> None:
    monkeypatch.chdir("/")
    config = load_robot(
        find_file("diff_drive"), ('localisation.method="mcl"', 'localisation.map="room.toml"')
    )
    several = make_estimators(config, SE2(1.0, 1.0, 0.0), world.parent)
    assert several.localiser is not None
    with pytest.raises(ConfigError, match=r"room\.toml"):
        make_estimators(config, SE2(1.0, 1.0, 0.0), Path("/"))


def test_an_image_alone_is_no_map() -> None:
    with pytest.raises(ConfigError, match=r"office\.pgm: an image; .* \.yaml"):
        load_localisation_map("office.pgm", Path())


def test_the_room_of_these_tests_is_the_one_of_the_file(world: Path) -> None:
    from robotctl.maps.world import load_walls

    walls = load_walls(world)
    assert isinstance(walls, WallMap)
    assert walls.segments == pytest.approx(ROOM)


@pytest.mark.parametrize("method", ["ekf", "mcl"])
@pytest.mark.parametrize(
    ("last", "sigma_m"),
    [
        (None, 0.1),
        (SE2(1.0, 1.0, 0.0), 0.1),
        (SE2(3.0, 2.5, 1.2), LocalisationConfig().restart_sigma_m),
    ],
    ids=["first start", "before it has moved", "under way"],
)
def test_started_again_under_way_the_localiser_begins_where_the_robot_was_last(
    world: Path, method: str, last: SE2 | None, sigma_m: float
) -> None:
    overrides = (f'localisation.map="{world}"', f'localisation.method="{method}"', "sonar=[]")
    options = StackOptions("x", str(find_file("diff_drive")), overrides, x_m=1.0, y_m=1.0)
    several = load_estimators(options.load(), options, last)
    state = control(0, SE2(0.0, 0.0, 2.0))  # how control's odometry began does not matter
    found = several.step(state, (), (), 0)
    there, expected = pose_in_world(state, found), last or SE2(1.0, 1.0, 0.0)
    assert distance(there, expected) < sigma_m / 4
    assert abs(wrap_angle(there.theta_rad - expected.theta_rad)) < math.radians(1.5)
    assert math.sqrt(found.covariance[0]) == pytest.approx(sigma_m, rel=0.1)


def options_with(tmp_path: Path, settings: str) -> StackOptions:
    """Return a copy of the shipped robot's file with other settings of localisation."""
    return StackOptions(
        "x", str(find_file("diff_drive")), tuple(settings.replace("DIR", str(tmp_path)).split("\n"))
    )


def test_a_map_that_the_disk_does_not_give_is_an_error_with_a_reason(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").symlink_to("/proc/self/mem")  # of which the first byte is nobody's
    options = options_with(tmp_path, 'localisation.method="mcl"\nlocalisation.map="DIR/room.yaml"')
    with pytest.raises(ConfigError) as refused:
        load_estimators(options.load(), options)
    assert "mem: cannot be read: [Errno 5] Input/output error" in str(refused.value)


def test_a_kernel_that_cannot_be_saved_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        (tmp_path / "none" / "kernel.nbc").open("wb")

    monkeypatch.setattr(OccupancyGrid, "update_scan", refuse)
    options = options_with(tmp_path, "localisation.mapping=true")
    with pytest.raises(ConfigError, match=rf"localisation: {tmp_path}/none/kernel.nbc: No such"):
        load_estimators(options.load(), options)


def test_a_disk_that_takes_no_compiled_kernels_is_an_error_with_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(OccupancyGrid, "update_scan", full)
    options = options_with(tmp_path, "localisation.mapping=true")
    with pytest.raises(ConfigError, match=r"localisation: No space left on device$"):
        load_estimators(options.load(), options)


@pytest.mark.parametrize("method", ["none", *LOCALISERS])
def test_each_localiser_is_chosen_by_a_robots_file(world: Path, method: str) -> None:
    overrides = (f'localisation.map="{world}"', f'localisation.method="{method}"')
    several = make_estimators(
        load_robot(find_file("diff_drive"), overrides), SE2(1.0, 1.0, 0.5), world.parent
    )
    state = several.step(control(0, SE2(7.0, 0.0, 2.0)), (), (), 0)
    assert (state and state.method) == (None if method == "none" else method)
    several.close()


@pytest.mark.parametrize(
    ("setting", "allowed"),
    [('places="a.toml"', '"mcl"'), ('keyframes="a"', '"slam"'), ('start="unknown"', '"mcl"')],
)
def test_a_setting_that_means_nothing_to_a_localiser_is_refused_with_those_it_helps(
    setting: str, allowed: str
) -> None:
    overrides = ('localisation.method="ekf"', 'localisation.map="flat"', f"localisation.{setting}")
    with pytest.raises(ConfigError, match=f'needs method {allowed}, found "ekf"'):
        load_robot(find_file("diff_drive"), overrides)


def test_mapping_pauses_and_goes_on_by_a_parameter_and_says_so(world: Path) -> None:
    several = estimators(world, 'localisation.method="mcl"', "localisation.mapping=true")
    cells, said = [], []
    for step in range(120):
        if step in (40, 80):
            several.retune({"localisation.paused": step == 40, "limits.v_max_m_s": 0.1})
            said += several.take_notices()
        now_ns = 50 * MS * step
        pose = way(now_ns)
        found = several.step(control(now_ns, pose), [scan(now_ns, pose)], (), now_ns)
        assert found is not None
        assert found.paused is (40 <= step < 80)
        assert several.mapper is not None
        cells.append(several.mapper.grid.to_map().cells.copy())
    said += several.take_notices()
    assert [each for each in said if each.startswith("mapping")] == [
        "mapping paused: the map stays as it is",
        "mapping goes on",
    ]
    assert np.array_equal(cells[39], cells[79])
    assert not np.array_equal(cells[79], cells[-1])


def test_a_robot_whose_file_says_paused_begins_so(world: Path) -> None:
    several = estimators(world, 'localisation.method="mcl"', "localisation.paused=true")
    assert "mapping paused: the map stays as it is" in several.take_notices()
