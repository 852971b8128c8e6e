"""Thresholds of the stages of SLAM by scans; light enough for every process to read."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from robotctl.errors import InvalidValue
from robotctl.estimation.places.visual.config import VisualConfig


def _check(config: object, shares: tuple[str, ...] = (), least: int = 1) -> None:
    """Raise `InvalidValue` unless shares are in [0, 1], counts >= `least`, other numbers > 0."""
    for each in fields(config):  # type: ignore[arg-type]
        key, value = each.name, getattr(config, each.name)
        if not isinstance(value, int | float):
            continue  # a nested group has checked itself
        if key in shares:
            if not 0.0 <= value <= 1.0:
                raise InvalidValue(key, f"{value} found, a number in [0, 1] allowed", value)
        elif isinstance(value, int):
            if value < least:
                raise InvalidValue(key, f"{value} found, {least} or more allowed", value)
        elif not 0.0 < value < math.inf:
            raise InvalidValue(key, f"{value} found, a finite number > 0 allowed", value)


@dataclass(frozen=True, slots=True)
class TrackingConfig:
    """How scans are registered on the map of the last keyframes.

    Parameters
    ----------
    search_points
        Number of points of a scan that the search compares, >= 1.
    wide_m, wide_points
        Half side from which a search window counts as wide [m], > 0, and its number of points,
        >= 1: there the time goes, and any place is a start for the refinement by all points.
    sure_score
        A match with a lower score is compared with that of a wider search, [0, 1].
    better_score
        Lead in score that the match of the wider search needs to replace the nearer one, [0, 1].
    wider
        Factor on the prior's standard deviations for the wider search, > 0.
    wider_m, wider_rad
        Minimum standard deviations there [m], [rad], > 0: wheels slip, clocks jump.
    farthest_m
        Maximum half side of a search window [m], > 0.
    corridor
        Ratio of the information along to that across, below which the prior holds a match along a
        corridor, [0, 1].
    still_matches
        Fraction of the inliers that a match held along a corridor must keep, [0, 1].
    velocity_factor
        Maximum multiple of the last motion that is predicted without odometry, > 0: after a pause,
        or if a clock jumps.
    confirming_keyframes
        Number of the last keyframes asked about a match that does not follow from where the robot
        was, >= 1; half of them must confirm it.
    confirmed_score
        Minimum score of such a match, [0, 1].
    confirmed_contradiction
        Maximum fraction of points by which a keyframe that confirms may contradict, [0, 1].
    lost_scans
        Number of consecutive unmatched scans after which the robot is lost, >= 1.
    unsure_m
        Distance after a slip, or after a relocalisation, on which keyframes are not refreshed
        [m], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    search_points: int = 180
    wide_m: float = 1.0
    wide_points: int = 60
    sure_score: float = 0.6
    better_score: float = 0.2
    wider: float = 2.5
    wider_m: float = 0.5
    wider_rad: float = 0.5
    farthest_m: float = 2.5
    corridor: float = 0.01
    still_matches: float = 0.75
    velocity_factor: float = 1.5
    confirming_keyframes: int = 4
    confirmed_score: float = 0.6
    confirmed_contradiction: float = 0.05
    lost_scans: int = 10
    unsure_m: float = 5.0

    def __post_init__(self) -> None:
        _check(
            self,
            (
                "sure_score",
                "better_score",
                "corridor",
                "still_matches",
                "confirmed_score",
                "confirmed_contradiction",
            ),
        )


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """How keyframes are matched and linked one by one.

    Parameters
    ----------
    least_overlap
        Minimum share of the echoes of each scan that the other sees, too, [0, 1].
    hopeless_overlap
        Overlap at the start below which a match is not tried, [0, 1].
    near_links, near_tries
        Number of links of a new keyframe with old ones beside it, and of matches tried for them,
        >= 1.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    least_overlap: float = 0.25
    hopeless_overlap: float = 0.1
    near_links: int = 4
    near_tries: int = 8

    def __post_init__(self) -> None:
        _check(self, ("least_overlap", "hopeless_overlap"))


@dataclass(frozen=True, slots=True)
class KnownPlacesConfig:
    """When a scan is of a place that is on the map already.

    Parameters
    ----------
    near_m
        Maximum distance of a keyframe that sees the same [m], > 0.
    tries
        Number of keyframes that are compared, >= 1.
    changed
        Fraction of contradicting points above which the scene has changed, [0, 1].
    young_m
        Travelled distance after which a keyframe may get a new scan [m], > 0: people walk about.
    match_m
        Residual beyond which a point has no weight in the match at first [m], > 0.
    confirming_keyframes
        Number of keyframes passed that decide on a relocalisation, >= 1; half must confirm it.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    near_m: float = 0.4
    tries: int = 3
    changed: float = 0.04
    young_m: float = 5.0
    match_m: float = 0.15
    confirming_keyframes: int = 6

    def __post_init__(self) -> None:
        _check(self, ("changed",))


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far from the pose that a recogniser suggests the robot may be.

    Parameters
    ----------
    shift_m, turn_rad
        To each side [m], [rad], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    shift_m: float = 1.5
    turn_rad: float = 0.5

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True, slots=True)
class ShapeConfig:
    """Candidates by the shape of the surroundings.

    Parameters
    ----------
    candidates
        Number of places suggested for each keyframe, >= 0.
    apart
        Minimum difference of their numbers, >= 0: neighbours in number are of one place.
    least_score
        Minimum score, [0, 1].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    candidates: int = 2
    apart: int = 6
    least_score: float = 0.65

    def __post_init__(self) -> None:
        _check(self, ("least_score",), least=0)


@dataclass(frozen=True, slots=True)
class VerificationConfig:
    """How scans verify that the robot is at a candidate place.

    Parameters
    ----------
    points
        Number of points that the search compares, >= 1.
    around, around_m
        Keyframes to each side of the old one, >= 1, and distance [m], > 0, that make up the place.
    recent, recent_m
        The same of the new keyframe.
    least_score, least_score_stretches
        Minimum score of the search, [0, 1]; that of stretches, since two walls side by side are in
        many places.
    least_inliers
        Minimum fraction of the echoes that match, [0, 1].
    ambiguous
        Another place in the window with this fraction of the score leaves it open which is right,
        [0, 1].
    pairs, pair_m
        Number of keyframes of the place linked with the new one, >= 1, and the residual beyond
        which a point has no weight in their matches at first [m], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    points: int = 360
    around: int = 6
    around_m: float = 5.0
    recent: int = 4
    recent_m: float = 2.0
    least_score: float = 0.45
    least_score_stretches: float = 0.75
    least_inliers: float = 0.5
    ambiguous: float = 0.93
    pairs: int = 3
    pair_m: float = 0.15

    def __post_init__(self) -> None:
        _check(self, ("least_score", "least_score_stretches", "least_inliers", "ambiguous"))


@dataclass(frozen=True, slots=True)
class LoopClosureConfig:
    """Which places are looked at for loops, and when a loop is closed.

    Parameters
    ----------
    near_m
        Maximum distance between keyframes that may see the same [m], > 0.
    gate
        Number of standard deviations of the map's uncertainty within which places are looked for,
        > 0.
    beyond
        Factor on that within which places may look alike, > 0: the covariance is a guess.
    slip
        Slip as a fraction of the distance, [0, 1]: without odometry, scans slip along bare walls
        unnoticed.
    queue
        Number of candidates that wait, of each kind, >= 1.
    apart_m, apart_alike_m
        Minimum distance travelled between two closures that confirm each other [m], > 0; of two
        by appearance alone, since rooms look alike.
    forget_m
        Maximum distance between them [m], > 0.
    agree_m, agree_rad
        Maximum difference of the two [m], [rad], > 0; a fiftieth of the distance is added.
    at_once
        Number of keyframes of a loaded map that recognisers take in with each new one, >= 1.
    shape, image, sonar
        Tolerance of the candidates by shape, by image and by a sonar turn.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    near_m: float = 3.0
    gate: float = 3.0
    beyond: float = 2.0
    slip: float = 0.2
    queue: int = 6
    apart_m: float = 0.4
    apart_alike_m: float = 2.0
    forget_m: float = 20.0
    agree_m: float = 0.2
    agree_rad: float = 0.05
    at_once: int = 8
    shape: Tolerance = field(default_factory=lambda: Tolerance(1.5, 0.35))
    image: Tolerance = field(default_factory=Tolerance)
    sonar: Tolerance = field(default_factory=lambda: Tolerance(1.0, 0.5))

    def __post_init__(self) -> None:
        _check(self, ("slip",))


@dataclass(frozen=True, slots=True)
class RelocalisationConfig:
    """How a lost robot is searched for on the whole map.

    Parameters
    ----------
    spacing_m, half_m
        Distance between the windows that cover the map, and half side of each [m], > 0.
    around, around_m
        Number of keyframes, >= 1, and distance [m], > 0, that make up a place.
    least_score
        Minimum score of the search, [0, 1].
    least_inliers
        Minimum fraction of the echoes that match, [0, 1].
    ambiguous
        Another place with this fraction of the score leaves it open which is right, [0, 1].
    same_m, same_rad
        Maximum difference of two finds of one place [m], [rad], > 0.
    moved
        Maximum fraction of contradicting points, [0, 1]: furniture is moved.
    clearly_more
        Lead in contradicting points, beside twice as many, by which a rival is ruled out, [0, 1].
    pairs, tries
        Number of keyframes that must match the scan one by one, and of those tried, >= 1.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    spacing_m: float = 1.0
    half_m: float = 1.0
    around: int = 12
    around_m: float = 2.5
    least_score: float = 0.6
    least_inliers: float = 0.6
    ambiguous: float = 0.9
    same_m: float = 0.5
    same_rad: float = 0.2
    moved: float = 0.08
    clearly_more: float = 0.05
    pairs: int = 2
    tries: int = 6

    def __post_init__(self) -> None:
        _check(self, ("least_score", "least_inliers", "ambiguous", "moved", "clearly_more"))


@dataclass(frozen=True, slots=True)
class StraightWallsConfig:
    """When the walls of two stretches are in line.

    Parameters
    ----------
    compared
        Number of earlier keyframes that a new one is linked with, >= 1.
    back_m
        Travelled distance on which odometry can tell which walls are in line [m], > 0.
    gate_rad, gate_m
        Maximum difference of direction [rad] and offset [m], > 0.
    apart_m
        Maximum distance between two pieces, and between keyframes [m], > 0.
    offset_m
        Offset above which two pieces may only be parallel, such as a radiator and the wall [m],
        > 0: they tell the heading alone.
    thickness_m
        Error of a piece across itself at its ends [m], > 0.
    bend_m
        Standard deviation of the offset [m], > 0: walls are not quite straight, nor are stretches.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    compared: int = 3
    back_m: float = 12.0
    gate_rad: float = 0.06
    gate_m: float = 0.15
    apart_m: float = 6.0
    offset_m: float = 0.1
    thickness_m: float = 0.03
    bend_m: float = 0.04

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True, slots=True)
class SlamTuning:
    """Thresholds of SLAM's stages, in the order in which a scan passes them.

    Parameters
    ----------
    tracking
        Registration of scans.
    known
        Places that are on the map already.
    links
        Matches of keyframes one by one.
    walls
        Walls in line, for scans made along the way.
    shapes, loops, verification
        Suggestion of loops, their choice, and their verification.
    images
        Recognition of images.
    relocalisation
        Search for a lost robot.
    """

    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    known: KnownPlacesConfig = field(default_factory=KnownPlacesConfig)
    links: LinkConfig = field(default_factory=LinkConfig)
    walls: StraightWallsConfig = field(default_factory=StraightWallsConfig)
    shapes: ShapeConfig = field(default_factory=ShapeConfig)
    loops: LoopClosureConfig = field(default_factory=LoopClosureConfig)
    verification: VerificationConfig = field(default_factory=VerificationConfig)
    images: VisualConfig = field(default_factory=VisualConfig)
    relocalisation: RelocalisationConfig = field(default_factory=RelocalisationConfig)
