"""`robotctl topology`: places and passages of a map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.files import check_files, give_plot, write_file
from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
from robotctl.words import counted

if TYPE_CHECKING:
    from robotctl.planning.map.topological.graph import Step

app = typer.Typer(no_args_is_help=True, help="Divide a map into places and passages.")

File = Annotated[Path, typer.Argument(help="File of `topology build`.")]


@app.command("build")
@takes_options
def build_command(
    world_map: Annotated[str, typer.Argument(metavar="MAP", help="ROS map (.yaml) or world.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Write places and passages here.")],
    marks: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="File of [[mark]]s (name, x_m, y_m): a place with one gets its name.",
        ),
    ] = "",
    robot: RobotFile = DEFAULT_ROBOT,
    plot: Annotated[
        Path | None, typer.Option(help="Draw places over the map: .png, .svg or .pdf.")
    ] = None,
    overrides: Overrides = (),
) -> None:
    """Find rooms, corridors, junctions and the passages between them in a map."""
    check_files(out, plot=plot)
    from robotctl.maps.topology_file import save_topology  # noqa: PLC0415 - it loads scipy
    from robotctl.workbench.topology import topology as work  # noqa: PLC0415

    built = work.build_topology(world_map, robot, overrides, marks)
    found = built.topology.map
    for place in found.places:
        print(
            f"{place.name}: {place.area_m2:.1f} m2, {place.width_m:.1f} m wide, "
            f"{counted(len(place.passages), 'passage')}"
        )
    for passage in found.passages:
        print(f"{passage.name}: {' - '.join(passage.between)}, {passage.width_m:.2f} m wide")
    write_file(out, lambda file: save_topology(found, file))
    places, passages = len(found.places), len(found.passages)
    print(f"{out}: {counted(places, 'place')}, {counted(passages, 'passage')}")
    if plot is not None:
        from robotctl.cli.topology.plot import save_plot  # noqa: PLC0415 - an extra

        give_plot(plot, lambda file: save_plot(built, file))


@app.command("name")
def name_command(
    file: File,
    place: Annotated[str, typer.Argument(help="Its name now.")],
    name: Annotated[str, typer.Argument(help="Its new name.")],
) -> None:
    """Give a place another name."""
    from robotctl.workbench.topology import topology as work  # noqa: PLC0415 - it loads scipy

    write_file(file, lambda path: work.rename_place(path, place, name))
    print(f"{file}: {place} is {name}")


def way_lines(start: str, way: Sequence[Step]) -> list[str]:
    """Return what to say of a way."""
    lines = [start]
    for step in way:
        turn = "" if step.left is None else f", {_turn(step.left, step.of)}"
        lines.append(
            f"  through {step.passage.name} ({step.passage.width_m:.2f} m wide){turn}\n"
            f"{step.place.name}"
        )
    length_m = way[-1].length_m if way else 0.0
    return [*lines, f"{counted(len(way), 'passage')}, about {length_m:.1f} m"]


def _turn(left: int, of: int) -> str:
    """Say which passage it is, counted from the one through which the robot came."""
    number, side = (left, "left") if 2 * left <= of else (of - left, "right")
    return f"number {number} to the {side}, of {counted(of, 'passage')}"
