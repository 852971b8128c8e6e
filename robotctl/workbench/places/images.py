"""`robotctl places match` and `train-vocabulary`: places by the images of a camera."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError, InvalidValue, PlaceError
from robotctl.estimation.places.recogniser import Recognition
from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.places.visual.recognition import (
    VisualCandidate,
    VisualPlaces,
    sight_of,
)
from robotctl.estimation.places.visual.training import train
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.logs.formats.image_folder import IMAGE_SUFFIXES, by_name, images_in
from robotctl.maps.image_file import read_image

COLUMNS: Final = (
    "image", "candidate", "score", "matches", "inliers", "share", "model", "accepted", "reason",
)  # fmt: skip

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class MatchedImages:
    """Result of recognising images.

    Parameters
    ----------
    images
        Files, in order.
    known
        Files that they were compared with; the same ones where each was with those before it.
    recognitions
        One for each image.
    """

    images: tuple[Path, ...]
    known: tuple[Path, ...]
    recognitions: tuple[Recognition[VisualCandidate], ...]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Image and known image of all that were recognised."""
        found = ((i, each.found) for i, each in enumerate(self.recognitions))
        return [(i, each.place) for i, each in found if each is not None]


@dataclass(frozen=True, slots=True)
class MatchQuality:
    """Recognitions against the truth.

    Parameters
    ----------
    accepted, right
        Recognised images, and those of them at the right place.
    possible
        Images of which the truth knows a place among the others.
    """

    accepted: int
    right: int
    possible: int

    @property
    def precision(self) -> float:
        """Share of the recognitions that are right; 1 where there are none."""
        return self.right / self.accepted if self.accepted else 1.0

    @property
    def recall(self) -> float:
        """Share of the possible recognitions that were made, and are right."""
        return self.right / self.possible if self.possible else 1.0


def find_images(given: Sequence[Path], besides: Path | None = None) -> list[Path]:
    """Return image files, those of one folder by name, numbers in it by their value.

    `besides` is no image of the drive though it may be in the folder: the truth.

    Raises
    ------
    ConfigError
        If a file does not exist, or a folder has no images.
    """

    def is_besides(file: Path) -> bool:
        return besides is not None and file.resolve() == besides.resolve()

    found: list[Path] = []
    for path in given:
        if not path.exists():
            raise ConfigError(f"{path}: no such file or folder")
        inside = [path]
        if path.is_dir():
            inside = images_in(path)
            if not inside:
                raise ConfigError(f"{path}: no images in it, of {', '.join(IMAGE_SUFFIXES)}")
        found += [each for each in inside if not is_besides(each)]
    folders = list(dict.fromkeys(each.parent for each in found))
    return sorted(found, key=lambda each: (folders.index(each.parent), by_name(each)))


def train_vocabulary(
    files: Sequence[Path], seed: int, reading: Progress, training: Progress
) -> Vocabulary:
    """Train a vocabulary on images.

    Raises
    ------
    ConfigError
        If an image cannot be read.
    PlaceError
        If they have too few features.
    """
    images = [each.descriptors for each in _features(files, reading)]
    try:
        return train(images, np.random.default_rng(seed), training)
    except InvalidValue as error:
        raise PlaceError(f"{len(files)} images: they {error.rule}") from error


def match_images(
    vocabulary: Vocabulary,
    images: Sequence[Path],
    known: Sequence[Path],
    gap: int,
    seed: int,
    progress: Progress,
) -> MatchedImages:
    """Recognise images among known ones, or, without these, each among those before it.

    Raises
    ------
    ConfigError
        If an image cannot be read.
    """
    places = VisualPlaces(vocabulary, gap, seed)
    total = len(known) + len(images)
    for done, features in enumerate(_features(known)):
        places.add(sight_of(vocabulary, features))
        progress(done + 1, total)
    recognitions = []
    for done, features in enumerate(_features(images)):
        sight = sight_of(vocabulary, features)
        recognitions.append(places.suggest(sight, is_next=not known))
        if not known:
            places.add(sight)
        progress(len(known) + done + 1, total)
    return MatchedImages(tuple(images), tuple(known or images), tuple(recognitions))


def read_truth(path: Path, images: int, known: int) -> NDArray[np.bool_]:
    """Read which images show the same place, (images, known): an image or a text of numbers.

    What is not 0 is true. Only the part below the diagonal counts where images are compared with
    those before them; a matrix without that is turned over.

    Raises
    ------
    ConfigError
        If it cannot be read, or has another size.
    """
    try:
        if path.suffix.lower() in IMAGE_SUFFIXES:
            pixels = read_image(path)
            matrix = (pixels if pixels.ndim == 2 else pixels[..., :3].max(axis=2)) > 127
        else:
            text = path.read_text(encoding="utf-8").replace(",", " ")
            matrix = np.loadtxt(text.splitlines(), ndmin=2) != 0
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: no matrix of truth: {error}") from error
    if matrix.shape != (images, known):
        rows, columns = matrix.shape
        raise ConfigError(
            f"{path}: {rows} rows and {columns} columns; needed are a row for each of {images} "
            f"images and a column for each of {known} that they are compared with"
        )
    return matrix


def quality(matched: MatchedImages, truth: NDArray[np.bool_]) -> MatchQuality:
    """Compare recognitions with the truth."""
    if matched.known == matched.images:
        truth = np.tril(truth | truth.T, -1)
    pairs = matched.pairs
    right = sum(bool(truth[pair]) for pair in pairs)
    return MatchQuality(len(pairs), right, int(np.count_nonzero(truth.any(axis=1))))


def write_pairs(matched: MatchedImages, file: Path) -> None:
    """Write a row for each candidate, and one for each image without any."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        writer.writerows(_rows(matched))


def _rows(matched: MatchedImages) -> Iterator[tuple[object, ...]]:
    for image, recognition in zip(matched.images, matched.recognitions, strict=True):
        if not recognition.candidates:
            yield image, "", "", "", "", "", "", 0, recognition.refusal
        for each in recognition.candidates:
            yield (
                image,
                matched.known[each.place],
                f"{each.score:.4f}",
                each.matches,
                each.inliers,
                f"{each.share:.3f}",
                each.model,
                int(not each.refusal),
                each.refusal,
            )


def _features(
    files: Sequence[Path], progress: Progress = lambda _done, _total: None
) -> Iterator[Features]:
    for done, file in enumerate(files):
        yield features_in(file)
        progress(done + 1, len(files))


def features_in(file: Path) -> Features:
    """Return the features of an image.

    Raises
    ------
    ConfigError
        If it cannot be read.
    """
    return features_of(_grey(file))


def _grey(file: Path) -> NDArray[np.uint8]:
    """Read an image as grey values of 8 bits."""
    try:
        pixels = read_image(file)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{file}: cannot be read: {error}") from error
    if pixels.ndim == 2:
        return (pixels if pixels.dtype == np.uint8 else pixels >> 8).astype(np.uint8)
    if pixels.shape[2] == 2:
        return np.ascontiguousarray(pixels[..., 0]).astype(np.uint8)
    grey: NDArray[np.uint8] = cv2.cvtColor(
        np.ascontiguousarray(pixels[..., :3]).astype(np.uint8), cv2.COLOR_RGB2GRAY
    ).astype(np.uint8)
    return grey
