"""Dubins and Reeds-Shepp paths: they end where they should, and none that is found is shorter."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from robotctl.planning.path.global_planning.curves import along, dubins, reeds_shepp

POSES = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-math.pi, math.pi))
CURVES = {"dubins": dubins, "reeds_shepp": reeds_shepp}


def end(path):
    """Return where a path leads, piece by piece in complex numbers."""
    place, heading = 0j, 0.0
    for turn, length in zip(*path, strict=True):
        if turn:
            centre = place + turn * 1j * np.exp(1j * heading)
            place = centre + (place - centre) * np.exp(1j * turn * length)
            heading += turn * length
        else:
            place += length * np.exp(1j * heading)
    return place, heading


def length(path):
    return float(np.abs(path[1]).sum())


BESIDE = 1e-7
"""A path ends so near to its pose [radii], and may be so much shorter: none is a path, too."""


@pytest.mark.parametrize("name", CURVES)
@given(pose=POSES)
def test_a_path_ends_at_its_pose(name, pose):
    path = CURVES[name](*pose)
    place, heading = end(path)
    assert place == pytest.approx(complex(*pose[:2]), abs=BESIDE)
    assert math.remainder(heading - pose[2], math.tau) == pytest.approx(0.0, abs=BESIDE)
    if name == "dubins":
        assert (path[1] >= 0.0).all()


@given(POSES)
def test_with_reverse_no_path_is_longer_and_none_is_shorter_than_the_straight_line(pose):
    free, forward = length(reeds_shepp(*pose)), length(dubins(*pose))
    assert math.hypot(*pose[:2]) - BESIDE <= free <= forward + BESIDE
    assert free >= abs(pose[2]) - 1e-9, "the circle is the tightest turn"


@given(POSES)
def test_the_way_back_mirrored_or_reversed_is_as_long(pose):
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    back = (-c * x - s * y, s * x - c * y, -theta)
    expected = length(reeds_shepp(*pose))
    for other in (back, (x, -y, -theta), (-x, y, -theta)):
        assert length(reeds_shepp(*other)) == pytest.approx(expected, abs=1e-6)
    assert length(dubins(x, -y, -theta)) == pytest.approx(length(dubins(*pose)), abs=1e-6)


@pytest.mark.parametrize(
    ("curve", "pose", "expected"),
    [
        (dubins, (4.0, 0.0, 0.0), 4.0),
        (dubins, (0.0, 2.0, math.pi), math.pi),
        (dubins, (-1.0, 0.0, 0.0), None),  # all the way round: longer than a circle
        (reeds_shepp, (-3.0, 0.0, 0.0), 3.0),
        (reeds_shepp, (0.0, 0.0, math.pi), math.pi),
        (reeds_shepp, (1.0, 1.0, math.pi / 2), math.pi / 2),
    ],
)
def test_paths_that_are_known(curve, pose, expected):
    found = length(curve(*pose))
    if expected is None:
        assert found > math.tau
    else:
        assert found == pytest.approx(expected, abs=1e-9)


def shortest_word(pose, words, signs, rng):
    """Return the least length over words by solving for the lengths numerically."""

    def gap(lengths, word):
        place, heading = end((word, lengths))
        miss = place - complex(*pose[:2])
        return [miss.real, miss.imag, math.remainder(heading - pose[2], math.tau)]

    best = math.inf
    for word, sign in itertools.product(words, signs):
        for _ in range(4):
            start = rng.uniform(0.1, 3.0, 3) * sign
            low = np.where(np.array(sign) > 0, 0.0, -8.0)
            high = np.where(np.array(sign) > 0, 8.0, 0.0)
            found = least_squares(gap, start, bounds=(low, high), args=(word,), xtol=1e-12)
            if found.cost < 1e-14:
                best = min(best, float(np.abs(found.x).sum()))
    return best


@pytest.mark.parametrize("seed", range(6))
def test_no_path_of_three_pieces_that_a_solver_finds_is_shorter(seed):
    rng = np.random.default_rng(seed)
    pose = (*rng.uniform(-3, 3, 2), rng.uniform(-math.pi, math.pi))
    words = [(1, 0, 1), (1, 0, -1), (-1, 0, 1), (-1, 0, -1), (1, -1, 1), (-1, 1, -1)]
    forward = shortest_word(pose, words, [(1, 1, 1)], rng)
    assert length(dubins(*pose)) <= forward + 1e-5
    either = shortest_word(pose, words, list(itertools.product((1, -1), repeat=3)), rng)
    assert length(reeds_shepp(*pose)) <= either + 1e-5


@pytest.mark.parametrize("name", CURVES)
@given(pose=POSES, radius=st.floats(0.2, 5.0), spacing=st.floats(0.05, 1.0))
def test_poses_along_a_path_are_near_each_other_and_end_at_its_end(name, pose, radius, spacing):
    path = CURVES[name](pose[0] / radius, pose[1] / radius, pose[2])
    poses, gears = along(path, radius, spacing)
    assert poses[-1, :2] == pytest.approx(pose[:2], abs=1e-6 * radius)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max(initial=0.0) <= spacing + 1e-9
    steps = np.diff(poses, axis=0)
    ahead = np.cos(poses[:-1, 2] + 0.5 * steps[:, 2]) * steps[:, 0]
    ahead += np.sin(poses[:-1, 2] + 0.5 * steps[:, 2]) * steps[:, 1]
    assert (np.sign(ahead[np.abs(ahead) > 1e-9]) == gears[1:][np.abs(ahead) > 1e-9]).all()
