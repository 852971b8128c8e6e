"""Images and keyframes of a robot that maps: they meet by their times."""

from types import SimpleNamespace

import numpy as np
import pytest

from robotctl.app.localisation.seen_images import SeenImages
from robotctl.estimation.places.visual.features import Features, features_in
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.seen_places import SeenPlaces
from robotctl.messages.estimation import CameraView, ImageFeatures

MS = 1_000_000


def features(number):
    """Return features that tell their number."""
    descriptors = np.full((3, 4), number, np.uint64)
    points = np.arange(6, dtype="<f4").reshape(3, 2) + number
    return ImageFeatures(points.tobytes(), descriptors.tobytes(), 0.75)


def view(stamp_ms, number):
    return CameraView(stamp_ms * MS, 0.0, 0.0, 1.0, (), (), (), (), features=features(number))


@pytest.fixture
def shown(monkeypatch):
    """Keyframe and number of the image of each that was shown."""
    seen = []

    def see(_, number, image: Features):
        seen.append((number, int(image.descriptors[0, 0])))

    monkeypatch.setattr(SeenPlaces, "see", see)
    return seen


def test_each_keyframe_gets_the_image_nearest_in_time_if_there_is_one(shown):
    old = [SimpleNamespace(stamp_ns=0)]
    mapper = SimpleNamespace(config=KeyframeConfig(), keyframes=old, images={}, loops=None)
    images = SeenImages(mapper)
    images.add([view(0, 1), view(250, 2), view(500, 3), view(5000, 4)])
    # A stretch tells where the robot was half a minute ago; nobody looked at 2 s, and
    # an image has one keyframe.
    mapper.keyframes = [*old, *(SimpleNamespace(stamp_ns=t * MS) for t in (260, 300, 2000, 4800))]
    images.show_new()
    images.show_new()
    assert shown == [(1, 2), (4, 4)]


def test_a_message_has_the_features_as_they_were():
    got = features_in(features(5))
    assert got.points.tolist() == [[5.0, 6.0], [7.0, 8.0], [9.0, 10.0]]
    assert got.descriptors.tolist() == [[5, 5, 5, 5]] * 3
    assert got.aspect == 0.75
