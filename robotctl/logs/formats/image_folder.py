"""Folders of images: a drive seen by its camera, each image with its time.

The time is the name, or in a list with lines `stamp path` (TUM RGB-D,
https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats), `stamp,name` (EuRoC), or only a
time for each image in the order of names (KITTI).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, DecimalException
from pathlib import Path
from typing import Final

from robotctl.logs.formats.log_text import LogFormatError, LogText, read_text
from robotctl.logs.formats.times import FIRST_S, LAST_S

IMAGE_SUFFIXES: Final = (
    ".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp",
)  # fmt: skip
"""Endings of the images of a folder."""
LISTS: Final = ("times.txt", "rgb.txt", "images.txt", "data.csv")
"""Names of a list of times, besides that of the folder with `.txt`."""

_DIGITS: Final = {19: Decimal("1e-9"), 16: Decimal("1e-6"), 13: Decimal("1e-3")}
"""Unit of a time without a point, by its number of digits [s]."""
_SECONDS: Final = re.compile(r"\d+\.\d+")
_ALLOWED: Final = (
    "allowed are seconds with decimals (1305031102.175304), or 19 digits of nanoseconds, "
    "16 of microseconds, 13 of milliseconds, with zeros in front"
)


@dataclass(frozen=True, slots=True)
class TimedImage:
    """An image of a drive.

    Parameters
    ----------
    stamp_ns
        Time of the exposure by the clock of the drive's log [ns].
    path
        File of the image.
    """

    stamp_ns: int
    path: Path


def image_name(stamp_ns: int) -> str:
    """Return the name, without suffix, of an image of a time [ns]; names sort as times do."""
    return f"{stamp_ns:019d}"


def images_in(folder: Path) -> list[Path]:
    """Return the images of a folder by name, with numbers in names by value.

    Raises
    ------
    OSError
        If the folder cannot be read.
    """
    found = (each for each in folder.iterdir() if each.suffix.lower() in IMAGE_SUFFIXES)
    return sorted(found, key=by_name)


def by_name(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return the sort key of a name, by which 2.jpg comes before 10.jpg."""
    parts = re.findall(r"\d+|\D+", path.stem)
    return [(int(each), "") if each.isdigit() else (-1, each) for each in parts], path.name


def timed_images(folder: Path) -> list[TimedImage]:
    """Return the images of a folder with their times, in the order of time.

    A list precedes names: one of `LISTS`, or `FOLDER.txt`, in the folder or beside it.

    Raises
    ------
    LogFormatError
        If there are no images, or one has no time; it names the file.
    OSError
        If a file cannot be read.
    """
    if not folder.is_dir():
        problem = "a file" if folder.exists() else "nothing"
        raise LogFormatError(f"{folder}: a folder of images is needed, found {problem}")
    images = images_in(folder)
    listed = _list_of(folder, beside=bool(images))
    if listed is not None:
        timed = list(_listed(listed, folder, images))
    elif images:
        timed = [TimedImage(_stamp_of_name(each), each) for each in images]
    else:
        raise LogFormatError(
            f"{folder}: no images in it, of {', '.join(IMAGE_SUFFIXES)}{_hint(folder)}"
        )
    return sorted(timed, key=lambda each: each.stamp_ns)


def _hint(folder: Path) -> str:
    """Return a hint at a subfolder with images, for a folder without any."""
    within = sorted(each for each in folder.iterdir() if each.is_dir())
    return next((f"; there are some in {each}" for each in within if images_in(each)), "")


def _list_of(folder: Path, *, beside: bool) -> Path | None:
    """Return the list of a folder's times, None without one; with `beside` also one beside it."""
    whole = folder.resolve()
    own = f"{whole.name}.txt"
    near = [folder / name for name in (own, *LISTS)]
    if beside:
        # Another folder's list, such as `rgb.txt` beside `depth`, does not count.
        near += [whole.parent / name for name in (own, "times.txt", "data.csv")]
    return next((each for each in near if each.is_file()), None)


def _listed(path: Path, folder: Path, images: list[Path]) -> Iterator[TimedImage]:
    """Yield the images of a list."""
    text = read_text(path)
    lines = [
        (number, words)
        for number, line in enumerate(text.lines, 1)
        if (words := line.replace(",", " ").split(maxsplit=1)) and not words[0].startswith("#")
    ]
    if not lines:
        raise LogFormatError(f"{path}: no times in it; a line is `stamp path`, or a time")
    if all(len(words) == 1 for _, words in lines):
        if len(lines) != len(images):
            raise LogFormatError(
                f"{path}: {len(lines)} times for {len(images)} images in {folder}; "
                "needed is one for each, in the order of names"
            )
        for (number, (time,)), image in zip(lines, images, strict=True):
            yield TimedImage(_stamp_of_line(text, number, time), image)
        return
    for number, words in lines:
        if len(words) == 1:
            raise text.error(number, f"found {words[0]!r} alone, needed is `stamp path`")
        yield TimedImage(
            _stamp_of_line(text, number, words[0]),
            _file_of(text, number, words[1].strip(), folder),
        )


def _file_of(text: LogText, number: int, name: str, folder: Path) -> Path:
    """Return the file that a list names, beside the list or in the folder."""
    for parent in (text.path.parent, folder):
        if (parent / name).is_file():
            return parent / name
    raise text.error(number, f"{name}: no such file in {text.path.parent} or {folder}")


def _stamp_of_line(text: LogText, number: int, word: str) -> int:
    """Return the time [ns] in a line of a list."""
    try:
        time_s = Decimal(word) * _DIGITS.get(len(word) if word.isdigit() else 0, 1)
    except DecimalException:  # not a number, or beyond all bounds
        raise text.error(number, f"found {word!r}, a time is needed: {_ALLOWED}") from None
    if not (time_s.is_finite() and FIRST_S <= time_s <= LAST_S):
        raise text.error(number, f"time {word}: allowed are {FIRST_S:g} to {LAST_S:g} s")
    return round(time_s * 10**9)


def _stamp_of_name(image: Path) -> int:
    """Return the time [ns] in the name of an image."""
    name = image.stem
    unit_s = _DIGITS.get(len(name)) if name.isdecimal() and name.isascii() else None
    if unit_s is None and not _SECONDS.fullmatch(name):
        raise LogFormatError(
            f"{image}: the name is no time; {_ALLOWED}; else give the times in a list "
            f"({image.parent.name}.txt or {', '.join(LISTS)}: lines `stamp path`, or a time for "
            "each image)"
        )
    time_s = Decimal(name) * (unit_s or 1)
    if time_s > LAST_S:
        raise LogFormatError(f"{image}: time {time_s} s: allowed are up to {LAST_S:g} s")
    return round(time_s * 10**9)
