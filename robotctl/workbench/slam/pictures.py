"""`robotctl slam --images DIR`: the pictures of a drive, each beside the keyframe of its time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from robotctl.errors import ConfigError
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.seen_places import IMAGE_NS, SeenPlaces
from robotctl.logs.formats.image_folder import TimedImage, timed_images
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary
from robotctl.model.recording import RecordedScan
from robotctl.words import counted
from robotctl.workbench.places.images import MatchedImages, features_in


def pictures_of(folder: Path, scans: Sequence[RecordedScan]) -> list[TimedImage]:
    """Return the pictures of a drive with scans, by time.

    Raises
    ------
    LogFormatError, ConfigError
        If an image has no time, or none is of the time of the scans.
    OSError
        If a file cannot be read.
    """
    images = timed_images(folder)
    times_ns = [each.scan.stamp_ns for each in scans]
    first_ns, last_ns = min(times_ns), max(times_ns)
    if not any(first_ns - IMAGE_NS <= each.stamp_ns <= last_ns + IMAGE_NS for each in images):
        begin_ns, end_ns = images[0].stamp_ns, images[-1].stamp_ns
        raise ConfigError(
            f"--images {folder}: {len(images)} images of {1e-9 * begin_ns:.3f} to "
            f"{1e-9 * end_ns:.3f} s, none of the time of the log's scans, {1e-9 * first_ns:.3f} "
            f"to {1e-9 * last_ns:.3f} s; times by one clock are needed"
        )
    return images


class ShownPictures:
    """Shows a mapper the pictures of the keyframes that it adds to its map.

    Parameters
    ----------
    images
        By time.
    mapper
        The mapper.
    """

    def __init__(self, images: Sequence[TimedImage], mapper: SlamMapper) -> None:
        self._images = images
        self._stamps_ns = [each.stamp_ns for each in images]
        self._seen = SeenPlaces(load_vocabulary(shipped_vocabulary()), mapper)
        self._shown: list[Path] = []
        self._unreadable: list[str] = []

    def show_new(self) -> None:
        """Show the pictures of keyframes that are new, if there are any of their time."""
        for number, row in self._seen.due(self._stamps_ns):
            self._show(number, self._images[row].path)

    def _show(self, number: int, file: Path) -> None:
        """Show a keyframe's picture, unless it cannot be read: a power cut ends in the last one."""
        try:
            features = features_in(file)
        except ConfigError as error:
            self._unreadable.append(str(error))
            return
        self._seen.see(number, features)
        self._shown.append(file)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on pictures that were left out."""
        if not self._unreadable:
            return ()
        count, first = len(self._unreadable), self._unreadable[0]
        return (f"{counted(count, 'picture')} left out, the first: {first}",)

    @property
    def matched(self) -> MatchedImages:
        """Result for each picture that was shown."""
        shown, looked_at = tuple(self._shown), self._seen.recognitions
        before = self._seen.keyframes[: len(self._seen.keyframes) - len(looked_at)]
        known = (*(Path(f"keyframe-{each}") for each in before), *shown)
        return MatchedImages(shown, known, tuple(looked_at))
