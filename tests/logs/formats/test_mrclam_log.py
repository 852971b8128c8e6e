"""MRCLAM folders, written here, and what is read of them."""

import gzip

import numpy as np
import pytest

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.recording import Sighting

FILES = {
    "Barcodes.dat": "# Subject # Barcode #\n 1 5\n 2 14\n 6 72\n 7 27\n",
    "Landmark_Groundtruth.dat": "# x y\n 6 0.5 -4.25 0.001 0.002\n 7 0.75 -4.5 0.001 0.002\n",
    "Robot2_Odometry.dat": "# t v w\n100.5 \t 0.25 \t -0.5 \n101.5 0.5 0\n",
    "Robot2_Measurement.dat": "100.75 27 2.5 0.25\n100.75 5 1.5 0.1\n101 72 3.5 -0.5\n101 99 1 0\n",
    "Robot2_Groundtruth.dat": "100.0 1.0 2.0 0.5\n102.0 1.5 2.5 0.75\n",
}


@pytest.fixture
def folder(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_velocities_sightings_landmarks_and_truth_are_those_of_the_files(folder):
    recording = read_recording(folder, mrclam_robot=2)
    assert recording.twist_stamps_ns.tolist() == [100_500_000_000, 101_500_000_000]
    assert recording.twists.tolist() == [[0.25, -0.5], [0.5, 0.0]]
    assert recording.landmarks == {6: (0.5, -4.25), 7: (0.75, -4.5)}
    assert recording.sightings == (
        Sighting(100_750_000_000, 7, 2.5, 0.25),
        Sighting(101_000_000_000, 6, 3.5, -0.5),
    )
    assert recording.reference.poses.tolist() == [[1.0, 2.0, 0.5], [1.5, 2.5, 0.75]]


def test_sightings_of_robots_and_of_unknown_codes_are_counted(folder):
    notes = read_recording(folder, mrclam_robot=2).notes
    assert any("1 of 4 sightings are of other robots" in note for note in notes)
    assert any("1 of 4 sightings are of bar codes that belong to no" in note for note in notes)


def test_sightings_without_a_range_are_counted(folder):
    (folder / "Robot2_Measurement.dat").write_text("101 72 0.0 0.1\n101 72 1.5 0.1\n")
    recording = read_recording(folder, mrclam_robot=2)
    assert len(recording.sightings) == 1
    assert any("1 of 2 sightings have no range" in note for note in recording.notes)


def test_files_may_be_gzip(folder):
    plain = read_recording(folder, mrclam_robot=2)
    for path in list(folder.iterdir()):
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    packed = read_recording(folder, mrclam_robot=2)
    assert packed.sightings == plain.sightings
    np.testing.assert_array_equal(packed.twists, plain.twists)


def test_a_file_of_one_robot_names_the_robot(folder):
    assert read_recording(folder / "Robot2_Odometry.dat").name.endswith("robot 2")


@pytest.mark.parametrize("robot", [1, 6])
def test_a_robot_that_is_not_in_the_set_is_refused_with_those_that_are(folder, robot):
    with pytest.raises(LogFormatError, match=f"no odometry of robot {robot}; there is that of 2"):
        read_recording(folder, mrclam_robot=robot)


def test_a_missing_file_is_named(folder):
    (folder / "Barcodes.dat").unlink()
    with pytest.raises(LogFormatError, match=r"Barcodes\.dat is missing, with \.gz and without"):
        read_recording(folder, mrclam_robot=2)


def test_without_a_truth_there_is_no_reference(folder):
    (folder / "Robot2_Groundtruth.dat").unlink()
    assert read_recording(folder, mrclam_robot=2).reference is None


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("101.0 0.5", r"Robot2_Odometry\.dat:4: found 2 words, needed are 3: time, forward"),
        ("101.0 O.5 0", r"Robot2_Odometry\.dat:4: forward velocity: found 'O\.5'"),
        ("101.0 inf 0", r"Robot2_Odometry\.dat:4: forward velocity: found 'inf'"),
    ],
)
def test_a_damaged_row_is_named(folder, line, message):
    text = f"{FILES['Robot2_Odometry.dat']}{line}\n102 0 0\n"
    (folder / "Robot2_Odometry.dat").write_text(text)
    with pytest.raises(LogFormatError, match=message):
        read_recording(folder, mrclam_robot=2)


def test_a_last_row_that_was_cut_is_left_out(folder):
    (folder / "Robot2_Odometry.dat").write_text(f"{FILES['Robot2_Odometry.dat']}102.5 0.")
    assert len(read_recording(folder, mrclam_robot=2).twists) == 2


@pytest.mark.recordings("mrclam/MRCLAM_Dataset7")
def test_the_public_set_is_read_whole(recordings):
    recording = read_recording(recordings / "mrclam" / "MRCLAM_Dataset7", mrclam_robot=2)
    assert len(recording.twists) == 60936
    assert len(recording.sightings) + 700 == 4518
    assert len(recording.landmarks) == 15
