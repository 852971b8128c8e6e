"""`robotctl places`: places that the robot knows by its sonars, or by images."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from robotctl.cli.arguments import refuse_unused
from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.cli.places.images import match, train_vocabulary
from robotctl.words import counted
from robotctl.workbench.places.options import PlaceSource

if TYPE_CHECKING:
    from robotctl.estimation.places.database import PlaceBook
    from robotctl.estimation.places.places import SonarCandidate
    from robotctl.workbench.places.places import Recognised
    from robotctl.workbench.places.turns import Progress

REFUSED = 3

app = typer.Typer(no_args_is_help=True, help="Learn and recognise places by sonar or images.")
app.command("train-vocabulary")(train_vocabulary)
app.command()(match)

Book = Annotated[Path, typer.Option(metavar="FILE", help="File of known places.")]
Plot = Annotated[Path | None, typer.Option(help="Plot to a .png, .svg or .pdf.")]


@app.command()
@takes_options
def learn(
    ctx: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the place, new or known.")],
    book: Book,
    source: PlaceSource,
) -> None:
    """Learn a place from a turn on the spot; learnt again, it is another visit.

    Give one of --log, --world and --live. Without --at the log's reference or the robot's own
    localiser says where the place is; without these it can be recognised, but not located.
    """
    from robotctl.workbench.places import places  # noqa: PLC0415 - it loads numba

    check_files(book)
    if not source.world:
        refuse_unused(ctx, "without --world", "seed")
    with _turning(source) as progress:
        learned = places.learn(name, book, source, progress, _tell)
    known = learned.book
    place = next(each for each in known.places if each.name == name)
    pose, heard = place.visits[-1].pose, place.visits[-1].signature
    where = f" at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m" if place.in_world else ""
    print(f"{name}: visit {len(place.visits)}{where}, echoes in {heard.echoes:.0%} of the readings")
    for other in learned.alike:
        print(f"{name} is hardly told from {other}: they may be taken for each other")
    print(
        f"{book}: {counted(len(known.places), 'place')}, accepted up to a difference of "
        f"{known.threshold:.3f}"
    )


@app.command()
@takes_options
def recognise(ctx: typer.Context, book: Book, source: PlaceSource, plot: Plot = None) -> None:
    """Turn on the spot and say which place it is, and how the robot is turned there.

    Status 0: recognised. 3: refused, with the reason. 2: bad input.
    """
    from robotctl.workbench.places import places  # noqa: PLC0415 - it loads numba

    check_files(plot=plot)
    if not source.world:
        refuse_unused(ctx, "without --world", "seed")
    with _turning(source) as progress:
        found = places.recognise(book, source, progress, _tell)
    for each in found:
        print("\n".join(_lines(each)))
    if plot is not None:
        from robotctl.cli.places.plot import save_recognition  # noqa: PLC0415
        from robotctl.maps.place_file import load_book  # noqa: PLC0415

        write_file(plot, lambda file: save_recognition(load_book(book), found, file))
        print(f"plot: {plot}")
    sys.exit(REFUSED if any(each.recognition.refusal for each in found) else 0)


@app.command("list")
def list_places(book: Book, plot: Plot = None) -> None:
    """List the known places, and how well they can be distinguished."""
    from robotctl.maps.place_file import load_book  # noqa: PLC0415 - it loads scipy

    check_files(plot=plot)
    known = load_book(book)
    plain_console().print(_table(known))
    for what, spread in (("visits to one place", known.within), ("other places", known.between)):
        source = f"{spread.measured} measured" if spread.measured else "expected, none measured"
        print(f"{what} differ by {spread.mean:.3f} ± {spread.sigma:.3f} ({source})")
    print(f"accepted up to a difference of {known.threshold:.3f}")
    if plot is not None:
        from robotctl.cli.places.plot import save_places  # noqa: PLC0415

        write_file(plot, lambda file: save_places(known, file))
        print(f"plot: {plot}")


@contextmanager
def _turning(source: PlaceSource) -> Iterator[Progress]:
    """Show how far the robot has turned; nothing if no terminal is."""
    console = plain_console(stderr=True)
    if source.live:
        console.print(f"turn {source.live} on the spot by 360°; Ctrl-C ends")
    with console.status("reading" if source.log else "waiting") as status:
        yield lambda turned_rad: status.update(f"turned {math.degrees(turned_rad):.0f}°")


def _tell(note: str) -> None:
    plain_console(stderr=True).print(f"note: {note}", soft_wrap=True)


def _lines(found: Recognised) -> Iterator[str]:
    """Yield what to say of a turn."""
    recognition = found.recognition
    place = recognition.found
    if place is None:
        yield f"refused: {recognition.refusal}"
    else:
        sigma_deg = math.degrees(math.sqrt(recognition.rotation_variance))
        yield (
            f"{place.place}: turned by {math.degrees(place.rotation_rad):.1f} ± {sigma_deg:.1f} "
            f"deg since its first visit; differs by {place.difference:.3f}, "
            f"{recognition.threshold:.3f} is allowed"
        )
    for each in recognition.candidates:
        if each.in_world or each is not place:
            yield f"  {_candidate(each)}"


def _candidate(candidate: SonarCandidate) -> str:
    """Return a candidate's line."""
    heading_deg = math.degrees(candidate.pose.theta_rad)
    sigma_m = math.sqrt(candidate.covariance[0, 0] + candidate.covariance[1, 1])
    where = (
        f"x {candidate.pose.x_m:.2f} m, y {candidate.pose.y_m:.2f} m ± {sigma_m:.2f} m, "
        f"heading {heading_deg:.1f} deg"
        if candidate.in_world
        else f"turned by {math.degrees(candidate.rotation_rad):.1f} deg"
    )
    return f"{candidate.place}: {where}, belief {candidate.score:.0%}"


def _table(known: PlaceBook) -> Table:
    """Return the places of a book."""
    table = Table()
    for head in ("place", "visits", "x m", "y m", "echoes", "own visits", "most like other place"):
        table.add_column(head)
    for place in known.places:
        own, least, other = known.apart(place.name)
        pose = place.visits[0].pose
        echoes = sum(visit.signature.echoes for visit in place.visits) / len(place.visits)
        table.add_row(
            place.name,
            str(len(place.visits)),
            *((f"{pose.x_m:.2f}", f"{pose.y_m:.2f}") if place.in_world else ("-", "-")),
            f"{echoes:.0%}",
            f"{own:.3f}" if math.isfinite(own) else "-",
            f"{other}: {least:.3f}" if other else "-",
        )
    return table
