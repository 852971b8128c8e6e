"""A short run of `python -m benchmarks camera-accuracy`: the goals, on few pictures of one seed."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.camera_accuracy import Beams, Things, views
from benchmarks.camera_scenes import cluttered_shots, geometry, office_shots
from firmware_sim.camera.truth import true_ranges
from firmware_sim.config.camera_parameters import CameraMount


@pytest.mark.parametrize("errors_of_mount", [None, 8])
def test_ranges_in_the_simulated_office_are_true_within_their_sigmas(
    errors_of_mount: int | None,
) -> None:
    beams = Beams()
    trusted = 0
    rng = None if errors_of_mount is None else np.random.default_rng(errors_of_mount)
    for shot, view in views(office_shots(np.random.default_rng(5), 2, 5), rng):
        beams.add(shot, view)
        trusted += view.trusted
    assert trusted == 10
    errors, truths = np.concatenate(beams.errors_m), np.concatenate(beams.truths_m)
    assert len(errors) > 150
    assert np.median(np.abs(errors) / truths) < 0.02
    within = np.abs(errors) <= 3.0 * np.concatenate(beams.sigmas_m)
    assert within.sum() / (len(errors) + beams.missed) > 0.93


def test_obstacles_are_found_where_they_are_and_nowhere_else() -> None:
    things = Things()
    for shot, view in views(cluttered_shots(np.random.default_rng(6), 2, 6)):
        things.add(shot, view)
    assert things.wanted >= 8
    assert things.found >= 0.9 * things.wanted
    assert things.false == 0
    assert np.median([error for _, error in things.foot_errors_m]) < 0.03
    assert np.mean(np.array(things.nees) < 11.83) > 0.9


def test_the_truth_of_the_scenes_agrees_with_the_simulators_own() -> None:
    camera = geometry()
    mount = CameraMount(*(getattr(camera.mount, key) for key in CameraMount.__slots__))
    angles = np.linspace(-0.7, 0.7, 141)
    for shot in cluttered_shots(np.random.default_rng(7), 1, 4):
        mine, _ = shot.ranges(*camera.t_base_camera[:2], angles)
        assert mine == pytest.approx(true_ranges(shot.world, shot.pose, mount, angles), abs=1e-6)
