"""All behaviours: a new one is one file, and one line here."""

from __future__ import annotations

from typing import Final

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ExploreRequest, PlaceRequest, PositionRequest
from robotctl.planning.behave.behaviours.circle import CIRCLE, CircleItem
from robotctl.planning.behave.behaviours.dock import DOCK, DockItem
from robotctl.planning.behave.behaviours.explore import EXPLORE, GUIDED_EXPLORATION, ExploreItem
from robotctl.planning.behave.behaviours.follow_path import DRIVE, DriveItem
from robotctl.planning.behave.behaviours.follow_wall import FOLLOW_WALL, FollowWallItem
from robotctl.planning.behave.behaviours.goto import GOTO, GUIDED_POSITION, GotoItem
from robotctl.planning.behave.behaviours.goto_place import GOTO_PLACE, GUIDED_PLACE, GotoPlaceItem
from robotctl.planning.behave.behaviours.guarded import Guarded
from robotctl.planning.behave.behaviours.item import Item
from robotctl.planning.behave.behaviours.keep_distance import KEEP_DISTANCE, KeepDistanceItem
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot
from robotctl.planning.behave.behaviours.rejoin import Rejoining
from robotctl.planning.behave.behaviours.return_home import RETURN_HOME
from robotctl.planning.behave.behaviours.straight_to import STRAIGHT_TO, StraightToItem
from robotctl.planning.behave.behaviours.turn_to import TURN_TO, TurnToItem
from robotctl.planning.behave.behaviours.wait import WAIT, WaitItem
from robotctl.planning.behave.behaviours.wait_for import WAIT_FOR, WaitForItem

BEHAVIOURS: Final[dict[type | Mode, Kind]] = {
    DriveItem: DRIVE,
    FollowWallItem: FOLLOW_WALL,
    GotoItem: GOTO,
    GotoPlaceItem: GOTO_PLACE,
    ExploreItem: EXPLORE,
    StraightToItem: STRAIGHT_TO,
    TurnToItem: TURN_TO,
    WaitItem: WAIT,
    WaitForItem: WAIT_FOR,
    DockItem: DOCK,
    KeepDistanceItem: KEEP_DISTANCE,
    CircleItem: CIRCLE,
    PositionRequest: GUIDED_POSITION,
    ExploreRequest: GUIDED_EXPLORATION,
    PlaceRequest: GUIDED_PLACE,
    Mode.RTL: RETURN_HOME,
}
"""All, by what asks for them: an item of a mission's file, a request, a mode."""


def kind_of(item: Item) -> Kind | None:
    """Return the kind of behaviour of a mission's item; None: it only says which is next."""
    return BEHAVIOURS.get(type(item))


def behaviour_for(
    wanted: Item | PositionRequest | ExploreRequest | PlaceRequest | Mode, robot: NavigatedRobot
) -> Rejoining:
    """Return the supervised behaviour for an item, request or mode."""
    kind = BEHAVIOURS[wanted if isinstance(wanted, Mode) else type(wanted)]
    guarded = Guarded(
        kind.make(wanted, robot), robot.guard, robot.config.guard, kind.time_out_s(wanted)
    )
    return Rejoining(guarded, robot)
