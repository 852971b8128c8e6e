"""Recognising places by a camera: a real building driven twice, and the simulated office.

Beside it two plain ways to do the same: words alone (the candidate of most score), and ORB features
compared one by one (Lowe's ratio, the image of most matches). Of these the recall is that of the
best threshold without a false place, which nobody knows beforehand; robotctl has its defaults.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from firmware_sim.camera.camera import Camera
from firmware_sim.config.config import load_robot
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import find_file
from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.places.visual.matching import RATIO
from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.places.visual.recognition import VisualPlaces, sight_of
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary
from robotctl.planning.path.global_planning.plan import PlanFailure
from robotctl.workbench.places.images import find_images
from robotctl.workbench.planning.options import PlanOptions
from robotctl.workbench.planning.plan import make_plan

GAP = 10
MOST_ONE_BY_ONE = 100
"""Images that are compared one by one; more take minutes."""
LAP = ((3.0, 2.0), (3.0, 13.2), (14.0, 4.5), (20.0, 11.5), (29.0, 12.5))
"""Where the robot drives twice in the office, one after the other [m]."""
STEP_M = 0.6
NEAR_M, NEAR_RAD = 1.0, math.radians(25.0)
"""Poses that see the same place."""
FAR_M, FAR_RAD = 3.0, math.radians(60.0)
"""Poses that do not; what is between counts for nothing."""


def office(pitch_deg: float) -> tuple[list[Features], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return features of two laps, which pairs show the same place, and which are not wrong."""
    rng = np.random.default_rng(3)
    overrides = {"camera.mount.pitch_deg": pitch_deg}
    robot = load_robot(find_file("diff_drive"), overrides)
    camera = Camera(robot, load_world(find_file("office", "worlds")), 3)
    poses = []
    for begin, end in 2 * list(zip(LAP, LAP[1:] + LAP[:1], strict=True)):
        answer = make_plan(PlanOptions("office", (*begin, 0.0), (*end, 0.0))).answer
        assert not isinstance(answer, PlanFailure)
        path = answer.poses[:, :2]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        for s in np.arange(rng.uniform(0.0, STEP_M), along[-1] - 0.3, STEP_M):
            here, there = (np.array([np.interp(d, along, path[:, k]) for k in (0, 1)])
                           for d in (s, s + 0.3))  # fmt: skip
            heading = math.atan2(*(there - here)[::-1]) + rng.normal(0.0, math.radians(3.0))
            poses.append((*(here + rng.normal(0.0, 0.05, 2)), heading))
    looks = []
    for number, pose in enumerate(poses):
        picture = camera.look(*pose, number=number).picture
        looks.append(features_of(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)))
    at = np.array(poses)
    apart_m = np.linalg.norm(at[:, None, :2] - at[None, :, :2], axis=2)
    turned = np.abs((at[:, None, 2] - at[None, :, 2] + math.pi) % math.tau - math.pi)
    earlier = np.tri(len(at), k=-GAP - 1, dtype=np.bool_)
    truth = earlier & (apart_m < NEAR_M) & (turned < NEAR_RAD)
    return looks, truth, earlier & (apart_m < FAR_M) & (turned < FAR_RAD)


def building(folder: Path) -> tuple[list[Features], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return features of the images of RTAB-Map, and their truth."""
    truth = folder / "samples_GT.bmp"
    looks = [features_of(cv2.imread(str(file), 0)) for file in find_images([folder], truth)]
    matrix = cv2.imread(str(truth), 0) > 127
    return looks, matrix, matrix


def ours(looks: list[Features], truth: NDArray[np.bool_], allowed: NDArray[np.bool_]) -> list[str]:
    """Recognise by the defaults; return precision, recall, CPU time of an image."""
    vocabulary = load_vocabulary(shipped_vocabulary())
    spent_ms: list[float] = []
    for _ in range(2):  # the first round compiles
        places, pairs, spent_ms = VisualPlaces(vocabulary, GAP), [], []
        for i, features in enumerate(looks):
            began = time.thread_time()
            sight = sight_of(vocabulary, features)
            found = places.suggest(sight, is_next=True).found
            places.add(sight)
            spent_ms.append(1e3 * (time.thread_time() - began))
            if found is not None:
                pairs.append((i, found.place))
    counted = [pair for pair in pairs if truth[pair] or not allowed[pair]]
    right = sum(bool(truth[pair]) for pair in pairs)
    return [
        f"{right / max(1, len(counted)):.3f}",
        f"{right / np.count_nonzero(truth.any(axis=1)):.3f}",
        f"{np.mean(spent_ms):.2f}",
        f"{np.percentile(spent_ms, 99):.2f}",
    ]


def plain(
    looks: list[Features],
    truth: NDArray[np.bool_],
    allowed: NDArray[np.bool_],
    scores: Callable[[int], NDArray[np.float64]],
) -> list[str]:
    """Take the best of earlier images by a score; return the recall of the best threshold."""
    found, spent_ms = [], []
    for i in range(GAP + 1, len(looks)):
        began = time.thread_time()
        each = scores(i)[: i - GAP]
        spent_ms.append(1e3 * (time.thread_time() - began))
        best = int(np.argmax(each))
        found.append((float(each[best]), bool(truth[i, best]), bool(allowed[i, best])))
    least = max(score for score, _, is_allowed in found if not is_allowed)
    right = sum(is_right and score > least for score, is_right, _ in found)
    recall = right / np.count_nonzero(truth.any(axis=1))
    return ["1, set so", f"{recall:.3f}", f"{np.mean(spent_ms):.2f}",
            f"{np.percentile(spent_ms, 99):.2f}"]  # fmt: skip


def words_alone(looks: list[Features]) -> Callable[[int], NDArray[np.float64]]:
    """Score by words, of an index that is filled as the drive goes."""
    vocabulary = load_vocabulary(shipped_vocabulary())
    places = VisualPlaces(vocabulary, GAP)

    def scores(i: int) -> NDArray[np.float64]:
        while len(places) < i:
            places.add(sight_of(vocabulary, looks[len(places)]))
        sight = sight_of(vocabulary, looks[i])
        return places._index.scores(sight.words, sight.weights)

    return scores


def one_by_one(looks: list[Features]) -> Callable[[int], NDArray[np.float64]]:
    """Score by the number of ORB matches with each image, by OpenCV's matcher."""
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    bytes_ = [each.descriptors.view(np.uint8) for each in looks]

    def scores(i: int) -> NDArray[np.float64]:
        counts = np.zeros(i)
        for j in range(i - GAP):
            if len(bytes_[i]) and len(bytes_[j]) > 1:
                pairs = matcher.knnMatch(bytes_[i], bytes_[j], k=2)
                counts[j] = sum(a.distance < RATIO * b.distance for a, b in pairs)
        return counts

    return scores


def run(_rounds: int, _seconds: float) -> None:
    """Measure all."""
    sets = [(f"office, camera {pitch:g} deg down", office(pitch)) for pitch in (5.0, 22.0)]
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    images = folder / "places" / "rtabmap"
    if images.is_dir():
        sets.insert(0, ("RTAB-Map's building", building(images)))
    else:
        machine.note(f"images: not measured, no {images}; set ROBOTCTL_DATA")
    rows = []
    for name, (looks, truth, allowed) in sets:
        size = f"{len(looks)}, {np.count_nonzero(truth.any(axis=1))}"
        rows.append((name, size, "robotctl", *ours(looks, truth, allowed)))
        plain_words = plain(looks, truth, allowed, words_alone(looks))
        rows.append((name, size, "words alone", *plain_words))
        if len(looks) < MOST_ONE_BY_ONE:
            all_pairs = plain(looks, truth, allowed, one_by_one(looks))
            rows.append((name, size, "ORB one by one", *all_pairs))
    heads = ("images", "all, known places", "by", "precision", "recall", "mean, CPU ms", "p99")
    machine.table("Places by camera, without the search for features", heads, rows)
    _features_cost()


def _features_cost() -> None:
    """Say what the search for features costs."""
    rng = np.random.default_rng(0)
    grey = cv2.GaussianBlur(rng.integers(0, 256, (480, 640)).astype(np.uint8), (0, 0), 2.0)
    spent_ms = []
    for _ in range(30):
        began = time.process_time()
        features_of(grey)
        spent_ms.append(1e3 * (time.process_time() - began))
    machine.note(f"features of an image of 640 x 480: {np.median(spent_ms):.1f} ms CPU")
