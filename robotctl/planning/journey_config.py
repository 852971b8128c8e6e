"""Settings of recoveries, exploration and travel in a robot's file; without numpy."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.config_values import check_ranges


@dataclass(frozen=True, slots=True)
class RungsConfig:
    """How a robot in trouble tries to get on, see `Attempt`.

    Parameters
    ----------
    wait_s
        Maximum wait for what is in the way to move [s], 0 to 600.
    pause_s
        Pause before planning again on a higher rung, which gives people time to go [s], 0 to 600.
    back_m_s
        Speed of backing off [m/s], 0.02 to 1.
    turn_rad_s
        Turning rate of looking around, and of turning round on the spot [rad/s], 0.05 to 3.
    longest_s
        Maximum time of backing off or looking around [s], 1 to 600.
    progress_m
        Distance driven that counts as progress, after which the next trouble is a new one [m], 0.05
        to 100.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    wait_s: float = 2.5
    pause_s: float = 1.0
    back_m_s: float = 0.15
    turn_rad_s: float = 0.7
    longest_s: float = 15.0
    progress_m: float = 0.5

    def __post_init__(self) -> None:
        check_ranges(
            self,
            wait_s=(0.0, 600.0),
            pause_s=(0.0, 600.0),
            back_m_s=(0.02, 1.0),
            turn_rad_s=(0.05, 3.0),
            longest_s=(1.0, 600.0),
            progress_m=(0.05, 100.0),
        )


@dataclass(frozen=True, slots=True)
class PeopleConfig:
    """How journeys mind people, see `GiveWay`.

    Parameters
    ----------
    give_way_s
        Maximum time for which the robot stays out of somebody's way [s], 0 to 600; 0: it gives way
        to nobody.
    ahead_s
        Time ahead in which a meeting counts [s], 0.5 to 60: longer, it turns back earlier.
    pass_m
        Clearance with which the robot and somebody pass each other [m], 0 to 2: larger, it gives
        way in wider corridors.
    strays
        How far people stray to a side, per metre that they walk, 0 to 1: larger, it goes farther
        out of their way.
    group_m
        Distance between two people who walk alike up to which they walk together [m], 0 to 5:
        larger, the robot goes round couples that are farther apart, not through between them; 0: it
        takes everybody alone.
    queue_m
        Maximum distance between two people who walked up and stopped at which they stand in line,
        or talk [m], 0 to 5: larger, paths lead round lines with wider gaps; 0: paths lead through
        between people.
    door_m
        Extra length of a path that each door of the map counts as [m], 0 to 9: larger, longer ways
        without doors are taken; above 0, the robot waits beside doors, not in them.
    hidden_m_s
        Assumed speed of a person who comes along the robot's path from where its lidar does not
        look [m/s], 0 to 3: larger, it is slower before corners, and behind people, who hide the
        path; 0: nobody is expected there.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    give_way_s: float = 20.0
    ahead_s: float = 10.0
    pass_m: float = 0.1
    strays: float = 0.1
    group_m: float = 0.0
    queue_m: float = 0.0
    door_m: float = 0.0
    hidden_m_s: float = 0.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            give_way_s=(0.0, 600.0),
            ahead_s=(0.5, 60.0),
            pass_m=(0.0, 2.0),
            strays=(0.0, 1.0),
            group_m=(0.0, 5.0),
            queue_m=(0.0, 5.0),
            door_m=(0.0, 9.0),
            hidden_m_s=(0.0, 3.0),
        )


@dataclass(frozen=True, slots=True)
class ExplorationConfig:
    """How frontiers are chosen and left, see `Exploration`.

    Parameters
    ----------
    look_s
        Interval between two searches for frontiers [s], 0.1 to 60.
    compared
        Number of nearest frontiers whose paths are compared, 1 to 100.
    same_m
        Distance within which two frontiers are one [m], 0.05 to 10.
    patient_s, slower
        A frontier is given up after this time [s], 1 to 3600, and the time of its path at full
        speed times `slower`, 1 to 100.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    look_s: float = 1.0
    compared: int = 4
    same_m: float = 0.5
    patient_s: float = 20.0
    slower: float = 3.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            look_s=(0.1, 60.0),
            compared=(1, 100),
            same_m=(0.05, 10.0),
            patient_s=(1.0, 3600.0),
            slower=(1.0, 100.0),
        )


@dataclass(frozen=True, slots=True)
class TravelConfig:
    """How a robot travels by recognising places, see `Travel`.

    Parameters
    ----------
    look_s
        Interval between two comparisons with the present place [s], 0.05 to 60.
    drift
        Error of the robot's place per distance driven since the last scan that fitted, 0.001 to 1.
    wrong_m
        Distance driven without a fitting scan after which the place is searched for again [m], 0.1
        to 100.
    beside_m
        Distance to the side of a passage within which it counts as passed [m], 0 to 5.
    tries
        Times that the robot fails to get through a passage before it takes another way, 1 to 100.
    searches
        Maximum number of searches on one travel, 1 to 1000.
    roam_m, roam_s
        Distance [m], 0.1 to 100, and time [s], 1 to 3600, after which a search is repeated
        elsewhere.
    shifted_m
        Shift of a spot, against where it was seen first, that calls for a new plan [m], 0.01 to 5.
    spot_look_s
        Interval between two checks that a spot is free [s], 0.1 to 60.
    spot_changes
        Maximum changes to another spot, 0 to 1000: a person may walk to and fro there.
    spot_range_m
        Maximum distance at which a thing at a spot counts in its choice [m], 0.1 to 50.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    look_s: float = 0.4
    drift: float = 0.1
    wrong_m: float = 2.5
    beside_m: float = 0.4
    tries: int = 2
    searches: int = 8
    roam_m: float = 2.5
    roam_s: float = 20.0
    shifted_m: float = 0.2
    spot_look_s: float = 1.0
    spot_changes: int = 6
    spot_range_m: float = 5.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            look_s=(0.05, 60.0),
            drift=(0.001, 1.0),
            wrong_m=(0.1, 100.0),
            beside_m=(0.0, 5.0),
            tries=(1, 100),
            searches=(1, 1000),
            roam_m=(0.1, 100.0),
            roam_s=(1.0, 3600.0),
            shifted_m=(0.01, 5.0),
            spot_look_s=(0.1, 60.0),
            spot_changes=(0, 1000),
            spot_range_m=(0.1, 50.0),
        )
