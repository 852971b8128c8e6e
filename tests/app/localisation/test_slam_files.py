"""The file in which SLAM keeps its map: written while the robot drives, and taken up again."""

import numpy as np
import pytest

from robotctl.app.localisation.slam_files import KeyframeFile, keyframes_to_localise
from robotctl.errors import ConfigError, RobotctlError
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.saved_map import HEADING, whole_map
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.record_log import packed
from tests.app.simulation.missions import drive
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import scan_of

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def slam(file, *, mapping, seconds=12, start=()):
    """Drive in the flat with a map that is kept in a file."""
    settings = (
        'localisation.method="slam"',
        f'localisation.keyframes="{file}"',
        f"localisation.mapping={str(mapping).lower()}",
    )
    return drive(localisation=settings, max_seconds=seconds, start=start)


def test_a_robot_goes_on_with_its_map_and_localises_itself_in_it(tmp_path):
    file = tmp_path / "flat.keyframes"
    assert slam(file, mapping=True).localisation.error.max_m < 0.05
    first = load_keyframes(file)
    assert len(first.keyframes) > 3
    assert slam(file, mapping=True).localisation.error.max_m < 0.05
    second = load_keyframes(file)
    assert len(second.keyframes) == len(first.keyframes)
    content = file.read_bytes()
    # It stands elsewhere than it was when the map was saved.
    place = slam(file, mapping=False, seconds=5, start=(2.5, 1.5, 120.0)).localisation
    assert place.error.max_m < 0.05
    assert file.read_bytes() == content


def test_a_damaged_file_is_kept_and_the_map_begins_anew(tmp_path):
    file = tmp_path / "flat.keyframes"
    slam(file, mapping=True, seconds=4)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(RobotctlError, match="damaged"):
        slam(file, mapping=False)
    kept = KeyframeFile(file, "lidar")
    (notice,) = kept.take_notices()
    kept.close()
    aside = tmp_path / "flat.keyframes.damaged-1"
    assert "damaged" in notice
    assert str(aside) in notice
    assert aside.read_bytes() == content
    assert load_keyframes(file) is None


def map_made_by(sensor, file):
    """Keep a map of one scan in a file."""
    mapper = SlamMapper()
    mapper.add(scan_of(OFFICE, SE2(1.0, 1.0), np.random.default_rng(1)))
    file.write_bytes(HEADING + packed([whole_map(mapper, sensor, SE2(), (0, SE2()))]))


def test_a_map_made_by_another_sensor_is_refused_where_the_user_names_it(tmp_path):
    file = tmp_path / "office.keyframes"
    map_made_by("lidar", file)
    content = file.read_bytes()
    with pytest.raises(ConfigError, match=r"made by lidar, .* maps by sonar; name another file"):
        KeyframeFile(file, "sonar")
    map_made_by("sonar", tmp_path / "other.keyframes")
    with pytest.raises(ConfigError, match=r"other.keyframes: a map made by sonar"):
        keyframes_to_localise(tmp_path / "other.keyframes", "lidar")
    assert file.read_bytes() == content


def test_a_robots_own_map_made_by_another_sensor_is_set_aside(tmp_path):
    file = tmp_path / "slam.keyframes"
    map_made_by("sonar", file)
    content = file.read_bytes()
    kept = KeyframeFile(file, "lidar", is_own=True)
    (notice,) = kept.take_notices()
    kept.close()
    aside = tmp_path / "slam.keyframes.by-sonar-1"
    assert str(aside) in notice
    assert "the map begins anew" in notice
    assert aside.read_bytes() == content


def test_a_file_that_says_no_sensor_is_of_a_lidar(tmp_path):
    """As they were written before sonars' maps were kept."""
    file = tmp_path / "old.keyframes"
    map_made_by("", file)
    assert load_keyframes(file).sensor == "lidar"
