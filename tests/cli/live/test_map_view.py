"""The drawn map of a run: what stands where, in which colour."""

from array import array

import numpy as np

from robotctl.app.simulation.run_status import RunStatus
from robotctl.cli.live.map_view import RunMap, legend
from robotctl.messages.estimation import LiveMap, PlanView
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap

ROOM = np.array([[0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0]], dtype=float)
COLUMNS, ROWS = 80, 20
NOTHING = LiveMap(0, 1, 1, 0.1, 0.0, 0.0, bytes(1))


def packed(*numbers):
    return array("f", numbers).tobytes()


def plan(path=b"", arc=b"", obstacles=b"", moving=(), costs=NOTHING):
    return PlanView(0, path, arc, obstacles, moving, costs)


def drawn(shown):
    """Return the lines of a map, and what each character's style is."""
    pose = SE2(1.0, 1.0, 0.0)
    lines = list(
        RunMap(WallMap(ROOM)).draw(RunStatus(pose=pose, plan=shown), COLUMNS, ROWS).lines()
    )
    styles = [["" for _ in line.plain] for line in lines]
    for row, line in enumerate(lines):
        for span in line.spans:
            for column in range(span.start, span.end):
                styles[row][column] = str(span.style)
    return [line.plain for line in lines], styles


def where(styles, wanted):
    """Return rows and columns of a style."""
    return {
        (row, column)
        for row, line in enumerate(styles)
        for column, style in enumerate(line)
        if wanted in style.split(" on ")[0]
    }


def test_the_path_leads_through_its_places_and_the_arc_lies_over_it():
    text, styles = drawn(plan(packed(1, 1, 0, 7, 1, 0, 7, 3, 0), packed(1, 1, 0, 2, 1, 0)))
    path = where(styles, "green")
    rows = {row for row, _ in path}
    assert len(rows) >= 9  # up the right side: half of the room's height
    columns = {column for _, column in path}
    assert max(columns) - min(columns) > 45
    arc = where(styles, "yellow")
    assert arc
    assert max(column for _, column in arc) < min(columns) + 2
    assert any("→" in line for line in text)


def test_what_is_seen_and_what_moves_is_where_it_is():
    text, styles = drawn(plan(obstacles=packed(4, 2), moving=((6.0, 2.0, 0.0, 0.0, 0.2),)))
    ((seen_row, seen_column),) = where(styles, "red")
    ((row, column),) = where(styles, "magenta")
    assert row == seen_row
    assert text[row][column] == "P"
    assert 18 <= column - seen_column <= 21  # 2 of 8 m of 80 columns


def test_costs_are_the_ground_of_what_is_drawn_over_them():
    costs = LiveMap(0, 2, 2, 1.0, 3.0, 1.0, bytes([100, 40, 0, 0]))
    _, styles = drawn(plan(path=packed(3.5, 1.5, 0, 3.6, 1.5, 0), costs=costs))
    grounds = {style.rsplit("on ", 1)[1] for line in styles for style in line if "on " in style}
    assert grounds == {"grey30", "grey15"}
    assert any("green on grey30" in style for line in styles for style in line)


def test_the_legend_names_what_is_there():
    assert legend(RunStatus()).plain == ""
    assert legend(RunStatus(plan=plan())).plain == ""
    everything = plan(b"....", b"....", b"....", ((0.0, 0.0, 0.0, 0.0, 0.2),))
    assert legend(RunStatus(plan=everything)).plain == "path arc seen P moves"
