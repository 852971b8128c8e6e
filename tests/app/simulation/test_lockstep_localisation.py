"""The simulated robot finds out where it is, and maps, under the virtual clock."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robotctl.app.scoring.score import Report
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.tum import read_tum
from robotctl.maps.map_file import load_map
from robotctl.maps.world import load_walls
from robotctl.workbench.slam.scans import scan_slam
from tests.app.simulation.missions import drive, fingerprint, without_computing_times

MCL = ('localisation.method="mcl"',)
EKF = ('localisation.method="ekf"',)
UNKNOWN = ('localisation.start="unknown"',)
MAPPING = ("localisation.mapping=true",)


@pytest.fixture(scope="module")
def sonar_robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a robot like the default one without lidar."""
    text = find_file("diff_drive").read_text(encoding="utf-8")
    path = tmp_path_factory.mktemp("robot") / "sonar_only.toml"
    path.write_text(text[: text.index("# A planar lidar")], encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Path]:
    """Return the report of a drive that drew a map, and that map's file."""
    folder = tmp_path_factory.mktemp("mapped")
    report = drive(localisation=MCL + MAPPING, max_seconds=45, record=folder)
    return report, folder / "map-0001.yaml"


@pytest.mark.parametrize("robot", ["diff_drive", "tricycle"])
def test_a_robot_that_is_not_told_its_place_finds_it_and_completes_its_mission(robot: str) -> None:
    report = drive(robot, localisation=MCL + UNKNOWN)
    place = report.localisation
    assert report.mission_completed, report.message
    assert report.collisions == 0
    assert place.localised_after_s is not None
    assert place.localised_after_s < 60.0
    assert place.error.max_m < 0.15
    assert place.error.heading_rmse_rad < math.radians(3.0)


def test_the_ekf_corrects_what_wrong_wheels_make_of_the_odometry() -> None:
    wrong = ("simulation.errors.wheel_radius=[0.01, -0.01]",)
    report = drive(localisation=EKF, overrides=wrong, max_seconds=30)
    place = report.localisation
    assert report.collisions == 0
    assert place.localised_share > 0.95
    assert place.odometry_rmse_m > 0.3
    assert place.error.rmse_m < 0.3 * place.odometry_rmse_m


def test_a_robot_that_is_carried_away_finds_its_place_and_completes_its_mission() -> None:
    report = drive(localisation=MCL, faults=find_file("carried", "scenarios"))
    assert report.faults
    assert report.mission_completed, report.message
    assert report.collisions == 0
    assert report.localisation.wrong_s < 5.0
    assert report.pose_error.final_m < 0.2
    assert report.pose_error.final_rad < 0.2


def test_the_map_it_draws_is_that_of_the_room(mapped: tuple[Report, Path]) -> None:
    report, file = mapped
    assert report.map_quality.precision > 0.95
    assert report.map_quality.recall > 0.8
    grid = load_map(file)
    walls = load_walls(find_file("flat", "worlds")).segments
    cells = grid.centre_of(np.argwhere(grid.occupied()))
    assert np.mean(_distances(cells, walls) < 0.1) > 0.95


def test_sonars_alone_find_the_place_and_draw_a_map(sonar_robot: Path) -> None:
    report = drive(str(sonar_robot), localisation=MCL + UNKNOWN + MAPPING, max_seconds=45)
    place = report.localisation
    assert place.localised_after_s is not None
    assert place.error.rmse_m < 0.1
    assert report.map_quality.recall > 0.3


def test_the_same_seed_gives_the_same_estimates_to_the_byte(tmp_path: Path) -> None:
    options = {"localisation": MCL + UNKNOWN + MAPPING, "max_seconds": 8, "seed": 5}
    runs = [drive(record=tmp_path / name, **options) for name in ("a", "b")]
    first, second = (without_computing_times(report) for report in runs)
    del first["localisation"]["step_ms"], second["localisation"]["step_ms"]
    assert first == second
    assert fingerprint(tmp_path / "a") == fingerprint(tmp_path / "b")


def test_its_own_recording_has_scans_truth_and_odometry(tmp_path: Path) -> None:
    report = drive(localisation=MCL, max_seconds=6, record=tmp_path)
    recording = read_recording(tmp_path)
    truth = read_tum(tmp_path / "truth-0001.tum")
    assert len(recording.scans) == pytest.approx(10 * report.duration_s, abs=3)
    assert recording.odometry is not None
    scan = recording.scans[-1]
    assert scan.reference is not None
    there = truth.at(scan.scan.stamp_ns)
    assert there is not None
    assert math.hypot(scan.reference.x_m - there.x_m, scan.reference.y_m - there.y_m) < 0.01


def test_without_a_localiser_nothing_is_reported_of_one() -> None:
    report = drive(max_seconds=2)
    assert (report.localisation, report.map_quality) == (None, None)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (EKF + UNKNOWN, "start"),
        (('localisation.method="slma"',), "localisation.method"),
        ((*MCL, 'localisation.map="nowhere"'), "nowhere"),
        ((*MCL, 'localisation.map="flt"'), 'did you mean "flat"'),
        ((*MCL, 'localisation.map="nowhere.yaml"'), "nowhere.yaml"),
        ((*MCL, "localisation.sede=3"), 'did you mean "seed"'),
    ],
)
def test_settings_that_do_not_work_are_named(settings: tuple[str, ...], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        drive(max_seconds=1, localisation=settings)


def test_the_ekf_needs_walls(mapped: tuple[Report, Path]) -> None:
    with pytest.raises(ConfigError, match="walls"):
        drive(max_seconds=1, localisation=(*EKF, f'localisation.map="{mapped[1]}"'))


def test_a_map_it_drew_itself_is_enough_to_find_its_place(tmp_path: Path) -> None:
    drive(localisation=MAPPING, max_seconds=30, record=tmp_path)
    chart = (f'localisation.map="{tmp_path}/map-0001.yaml"',)
    report = drive(localisation=MCL + UNKNOWN + chart, max_seconds=20)
    assert report.localisation.localised_after_s is not None
    assert report.localisation.error.rmse_m < 0.15


def test_the_world_is_the_map_unless_another_is_named() -> None:
    options = SimOptions(Path("robot"), Path("mission"), localisation=MCL)
    assert options.settings(Path("/worlds/flat.toml"))[0] == 'localisation.map="/worlds/flat.toml"'
    assert SimOptions(Path("robot"), Path("mission")).settings(Path("/w.toml")) == ()


def _distances(points: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Return the distance of each point (n, 2) from the nearest wall."""
    a, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    to = points[:, None] - a
    share = np.clip(np.sum(to * along, axis=2) / np.sum(along * along, axis=1), 0.0, 1.0)
    return np.hypot(*np.moveaxis(to - share[..., None] * along, 2, 0)).min(axis=1)


def test_a_robot_with_two_sweeping_lidars_maps_by_both_and_its_log_too(tmp_path: Path) -> None:
    half = "fov_deg=180.0,beams=181"
    front = f'{{name="front",x_m=0.12,sweep_s=0.1,{half}}}'
    rear = f'{{name="rear",x_m=-0.12,heading_deg=180.0,sweep_s=-0.1,rate_hz=8.0,{half}}}'
    report = drive(
        localisation=('localisation.method="slam"', "localisation.mapping=true"),
        overrides=(f"simulation.lidar=[{front},{rear}]",),
        max_seconds=20,
        record=tmp_path,
    )
    assert report.collisions == 0
    assert report.localisation.error.max_m < 0.03
    assert report.map_quality.precision > 0.97
    scans = read_recording(tmp_path).scans
    assert {each.scan.name for each in scans} == {"front", "rear"}
    assert {each.scan.sweep_s for each in scans} == {0.0}  # unwound by the odometry
    result = scan_slam(tmp_path, None, lambda *_: None)
    assert all(len(each.scan.others) == 1 for each in result.mapper.keyframes[1:])
    assert result.report()["trajectory"]["rmse_m"] < 0.02
