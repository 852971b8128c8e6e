"""A log of two lasers that look to either side becomes one map, and goes on as one."""

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.slam.scan_files import write_scan_results
from robotctl.workbench.slam.scans import scan_slam
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import along, drifting, scan_of

HALF = np.radians(np.arange(-90.0, 90.5))
FRONT, REAR = SE2(0.25, 0.0, 0.0), SE2(-0.25, 0.0, np.pi)
PATH = along([(1.0, 1.0), (13.0, 1.0), (13.0, 8.0)], 0.3)
PARAMETERS = "PARAM robot_frontlaser_offset 0.25 h 0\nPARAM robot_rearlaser_offset -0.25 h 0\n"

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def line(word, mount, pose, wheels, number, rng):
    """Return what one laser saw at a place, its pose by the truth."""
    laser = pose @ mount
    ranges = np.minimum(scan_of(OFFICE, laser, rng, angles=HALF).ranges_m, 81.9)
    numbers = [len(ranges), *ranges, laser.x_m, laser.y_m, laser.theta_rad]
    numbers += [wheels.x_m, wheels.y_m, wheels.theta_rad]
    return (
        f"{word} {' '.join(f'{each:.6f}' for each in numbers[1:])}".replace(
            f"{word} ", f"{word} {len(ranges)} "
        )
        + f" {0.4 * number:.3f} h {0.4 * number:.3f}\n"
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return a CARMEN log of both lasers."""
    rng = np.random.default_rng(3)
    file = tmp_path_factory.mktemp("log") / "both.log"
    lines = [PARAMETERS]
    for number, (pose, wheels) in enumerate(zip(PATH, drifting(PATH, rng), strict=True), 1):
        lines.append(line("FLASER", FRONT, pose, wheels, number, rng))
        lines.append(line("RLASER", REAR, pose, wheels, number, rng))
    file.write_text("".join(lines), encoding="ascii")
    return file


@pytest.fixture(scope="module")
def result(log):
    return scan_slam(log, None, lambda *_: None)


def test_each_place_has_one_view_of_both(result):
    assert len(result.recording.scans) == len(PATH)
    assert any("2 lidars" in note for note in result.recording.notes)
    for each in result.mapper.keyframes:
        (rear,) = each.scan.others
        assert (rear.name, rear.x_m) == ("rear", pytest.approx(-0.25))
        assert rear.stamp_ns == each.scan.stamp_ns


def test_the_drive_is_that_of_the_building(result):
    assert result.report()["trajectory"]["rmse_m"] < 0.03
    assert result.verdict is not None
    assert result.verdict.quality.value == "good"


def test_the_map_keeps_both_and_another_drive_goes_on_with_them(result, log, tmp_path):
    write_scan_results(result, tmp_path)
    saved = load_keyframes(tmp_path / "map.keyframes")
    assert saved is not None
    for before, after in zip(result.mapper.keyframes, saved.keyframes, strict=True):
        assert after.scan.points_base() == pytest.approx(before.scan.points_base(), abs=1e-4)
    again = scan_slam(log, None, lambda *_: None, tmp_path / "map.keyframes")
    assert len(again.mapper.keyframes) < 1.3 * len(result.mapper.keyframes)


def test_a_sweep_longer_than_any_lidar_is_refused(log):
    with pytest.raises(ConfigError, match=r"--sweep 2: at most 1 s are allowed"):
        read_recording(log, sweep_s=2.0)
    assert {each.scan.sweep_s for each in read_recording(log, sweep_s=0.1).scans} == {0.0}
