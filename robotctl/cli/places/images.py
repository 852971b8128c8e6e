"""`robotctl places match` and `train-vocabulary`: places by the images of a camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.progress import progress_bar
from robotctl.words import counted

if TYPE_CHECKING:
    from robotctl.workbench.places.images import MatchedImages

Images = Annotated[list[Path], typer.Argument(help="Images, or folders of them.")]
Seed = Annotated[int, typer.Option(min=0, help="Of random draws.")]


def train_vocabulary(
    images: Images,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Write the vocabulary here, .npz.")],
    seed: Seed = 0,
) -> None:
    """Train a vocabulary of visual words on images of places like those to recognise."""
    check_files(out)
    from robotctl.maps.vocabulary_file import save_vocabulary  # noqa: PLC0415 - it loads numba
    from robotctl.workbench.places import images as work  # noqa: PLC0415 - it loads OpenCV

    files = work.find_images(images)
    console = plain_console(stderr=True)
    with (
        progress_bar(console, counted(len(files), "image"), "finding features") as reading,
        progress_bar(console, "descriptors", "dividing features") as training,
    ):
        vocabulary = work.train_vocabulary(files, seed, reading, training)
    write_file(out, lambda file: save_vocabulary(vocabulary, file))
    size_mb = out.stat().st_size / 1e6
    print(f"{out}: {vocabulary.words} words from {counted(len(files), 'image')}, {size_mb:.1f} MB")


def match(
    images: Images,
    against: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="IMAGES",
            help="Images or a folder to recognise them among; else those before each.",
        ),
    ] = None,
    vocabulary: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Of train-vocabulary; else the shipped one.")
    ] = None,
    gap: Annotated[
        int, typer.Option(min=0, help="Images before each that are of the same visit.")
    ] = 10,
    truth: Annotated[
        Path | None,
        typer.Option(help="Matrix of which show the same place: image, or text of 0 and 1."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write all candidates here, CSV.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw who was recognised as whom: .png, .svg or .pdf.")
    ] = None,
    seed: Seed = 0,
) -> None:
    """Recognise the place of each image of a drive among those before it, or among others.

    Status 0, whether or not any is recognised. 2: bad input.
    """
    check_files(out, plot=plot)
    from robotctl.maps import vocabulary_file  # noqa: PLC0415 - it loads numba
    from robotctl.workbench.places import images as work  # noqa: PLC0415 - it loads OpenCV

    files, known = work.find_images(images, truth), work.find_images(against or [], truth)
    right = None if truth is None else work.read_truth(truth, len(files), len(known or files))
    words = vocabulary_file.load_vocabulary(vocabulary or vocabulary_file.shipped_vocabulary())
    console = plain_console(stderr=True)
    with progress_bar(console, counted(len(files), "image"), "recognising") as tell:
        matched = work.match_images(words, files, known, gap, seed, tell)
    print("\n".join(_lines(matched)))
    if right is not None:
        reached = work.quality(matched, right)
        print(
            f"precision {reached.precision:.3f}: {reached.right} of {reached.accepted} are right\n"
            f"recall {reached.recall:.3f}: {reached.right} of {reached.possible} that are possible"
        )
    if out is not None:
        write_file(out, lambda file: work.write_pairs(matched, file))
        print(f"candidates: {out}")
    if plot is not None:
        from robotctl.cli.places.plot import save_matched  # noqa: PLC0415 - an extra

        write_file(plot, lambda file: save_matched(matched, right, file))
        print(f"plot: {plot}")


def _lines(matched: MatchedImages) -> Iterator[str]:
    """Yield what to say of images."""
    for image, recognition in zip(matched.images, matched.recognitions, strict=True):
        if (found := recognition.found) is not None:
            yield (
                f"{image.name}: as {matched.known[found.place].name}, {found.inliers} of "
                f"{found.matches} matches fit, {found.share:.0%} of the features"
            )
    refusals = Counter(each.refusal for each in matched.recognitions if each.refusal)
    yield f"{len(matched.pairs)} of {len(matched.images)} images recognised" + "".join(
        f"; {count} {reason}" for reason, count in refusals.most_common()
    )
