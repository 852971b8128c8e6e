from __future__ import annotations

import math

import numpy as np
import pytest

from sonar_ring import FRONT, NO_ECHO, Guess, map_of, ranked, read_ring, units

FILES = ("sonar/ring8_measurement.txt", "sonar/ring8_poses.txt")
RIGHT_FIRST = Guess("right", tuple(-angle for angle in FRONT))
LEFT_FIRST = Guess("left", FRONT)
FULL_RING = Guess("full", tuple(90.0 - 45.0 * k for k in range(8)))


def box_distance(x, y, angle, box=(-1.0, -1.5, 6.0, 1.2)):
    """Return the range from inside of a rectangle to its walls."""
    c, s = math.cos(angle), math.sin(angle)
    along = [((box[2] if c > 0 else box[0]) - x) / c if c else math.inf]
    along.append(((box[3] if s > 0 else box[1]) - y) / s if s else math.inf)
    return min(along)


def write_recording(folder, headings_deg):
    """Write a drive through a box, with sonars at the headings, in mm and tenths of a degree."""
    measured, posed = [], []
    for k in range(60):
        x, y, theta_deg = 0.07 * k, 0.3 * math.sin(0.1 * k), 20.0 * math.cos(0.13 * k)
        ranges = [
            1000.0 * box_distance(x, y, math.radians(theta_deg + heading))
            for heading in headings_deg
        ]
        measured.append([200 * k, *np.minimum(ranges, NO_ECHO)])
        posed.append([200 * k, 1000.0 * x, 1000.0 * y, 10.0 * theta_deg % 3600.0])
    np.savetxt(folder / "ring8_measurement.txt", measured, fmt="%.0f")
    np.savetxt(folder / "ring8_poses.txt", posed, fmt="%.0f")


@pytest.mark.parametrize(
    "truth", [RIGHT_FIRST, LEFT_FIRST, FULL_RING], ids=lambda guess: guess.name
)
def test_the_mounting_that_a_recording_was_made_with_is_found(tmp_path, truth):
    write_recording(tmp_path, truth.headings_deg)
    best = ranked(tmp_path, [LEFT_FIRST, FULL_RING, RIGHT_FIRST])
    assert best[0][1] is truth


@pytest.mark.recordings(*FILES)
def test_the_recorded_ring_is_an_arc_over_the_front_whose_first_sonar_looks_right(recordings):
    best = ranked(recordings / "sonar", [LEFT_FIRST, FULL_RING, RIGHT_FIRST])
    assert best[0][1] is RIGHT_FIRST
    assert best[0][0] - best[1][0] > 0.02


@pytest.mark.recordings(*FILES)
def test_its_units_are_millimetres_and_tenths_of_a_degree(recordings):
    names = (" 0.8 mm", " 1 mm", " 1.25 mm", " 0.09 deg", " 0.11 deg")
    tried = [guess for guess in units(RIGHT_FIRST) if guess.name.endswith(names)]
    assert len(tried) == len(names)
    assert ranked(recordings / "sonar", tried)[0][1].name == "a range of 1 is 1 mm"


@pytest.mark.recordings(*FILES)
def test_the_sonars_map_free_ground_between_the_walls_of_a_corridor_two_metres_wide(recordings):
    ring = read_ring(recordings / "sonar", RIGHT_FIRST)
    at = (ring.poses[:, 0] > 1.0) & (ring.poses[:, 0] < 8.0)
    poses, right_m, left_m = ring.poses[at], ring.ranges_m[at, 0], ring.ranges_m[at, 7]
    assert np.median(right_m + left_m) == pytest.approx(2.05, abs=0.1)
    assert np.std(right_m + left_m) < 0.1
    grid = map_of(ring, RIGHT_FIRST.mounts())
    odds, shown = grid.log_odds(), grid.to_map()
    for side, range_m in ((-1.0, right_m), (1.0, left_m)):
        across = side * np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
        beside, wall = (
            odds[tuple(shown.cell_of(poses[:, :2] + across * away_m[:, None]).T)]
            for away_m in (0.5 * range_m, range_m)
        )
        assert np.mean(beside < -2.0) > 0.95
        assert np.mean(wall > beside + 2.0) > 0.9
