"""The file in which SLAM keeps its map: written while the robot drives, and taken up again."""

import pytest

from robotctl.app.localisation.slam_files import KeyframeFile
from robotctl.errors import RobotctlError
from robotctl.logs.formats.keyframes_log import load_keyframes
from tests.app.simulation.missions import drive

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
    kept = KeyframeFile(file)
    (notice,) = kept.take_notices()
    kept.close()
    aside = tmp_path / "flat.keyframes.damaged-1"
    assert "damaged" in notice
    assert str(aside) in notice
    assert aside.read_bytes() == content
    assert load_keyframes(file) is None
