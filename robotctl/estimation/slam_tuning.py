"""Thresholds of the stages of SLAM by scans; light enough for every process to read."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from robotctl.config_values import ABOVE_0, check_ranges
from robotctl.estimation.places.visual.config import VisualConfig


def _check(config: object, shares: tuple[str, ...] = (), least: int = 1) -> None:
    """Raise `InvalidValue` unless shares are in [0, 1], counts >= `least`, other numbers > 0."""
    for each in fields(config):  # type: ignore[arg-type]
        value = getattr(config, each.name)
        if each.name in shares:
            check_ranges(config, **{each.name: (0.0, 1.0)})
        elif isinstance(value, int | float):  # a nested group has checked itself
            above = least if isinstance(value, int) else ABOVE_0
            check_ranges(config, **{each.name: (above, math.inf)})


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
class HypothesisConfig:
    """How scans are registered where no odometry tells the motion.

    Parameters
    ----------
    near_m, near_rad
        Half sides of the search window around the last pose [m], [rad], > 0.
    far_m, far_rad
        The same where nothing in that window is sure.
    sure_worth
        Plausibility of a place below which the far window is searched, too, [0, 1].
    points
        Number of points of a scan that the search compares, >= 1.
    most
        Number of places that are compared, >= 1.
    behind
        Maximum lag in score of a place behind the best one, [0, 1].
    through
        Loss of plausibility by the share of echoes that beams of the other scan went through, > 0.
    most_through
        Share that counts at most, > 0: where people stand about, beams go through all of them.
    same_evidence
        Lead in plausibility by which the expected place in a corridor is ruled out, [0, 1].
    unexpected, most_unexpected
        Loss of plausibility by the squared distance from the expected pose, in standard deviations,
        [0, 1], and the square that counts at most, > 0: a robot may do anything.
    far
        Loss by that squared distance in units of 0.5 m and 0.5 rad, without a limit, [0, 1].
    ambiguous
        Lead in plausibility below which the best place is ambiguous, [0, 1].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    near_m: float = 2.5
    near_rad: float = 1.6
    far_m: float = 4.0
    far_rad: float = math.pi
    sure_worth: float = 0.2
    points: int = 120
    most: int = 4
    behind: float = 0.2
    through: float = 2.0
    most_through: float = 0.15
    same_evidence: float = 0.02
    unexpected: float = 0.01
    most_unexpected: float = 9.0
    far: float = 0.006
    ambiguous: float = 0.1

    def __post_init__(self) -> None:
        _check(self, ("sure_worth", "behind", "unexpected", "far", "ambiguous"))


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When scans do not believe odometry.

    Parameters
    ----------
    through
        Share of echoes that beams of the other scan went through, above which a match near the
        odometry is compared with all places that fit, [0, 1].
    lead, lead_at_rest
        Lead in plausibility by which another place contradicts odometry, [0, 1]; the second where
        odometry says that the robot stands: then scans must be the same but for who walks by.
    pause, longest_pause
        Number of scans without such a comparison after one that found nothing, >= 1: people walk
        through beams, too. It doubles each time up to the second, as long as beams are interrupted.
    contradictions, of_last
        Number of contradicting scans, of so many last ones, after which odometry is left out, >= 1.
    agreed_m
        Distance on which all scans must agree with odometry until it is used again [m], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    through: float = 0.04
    lead: float = 0.1
    lead_at_rest: float = 0.03
    pause: int = 5
    longest_pause: int = 40
    contradictions: int = 2
    of_last: int = 4
    agreed_m: float = 2.0

    def __post_init__(self) -> None:
        _check(self, ("through", "lead", "lead_at_rest"))


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
    drift
        Standard deviation of the position as a fraction of the distance without odometry, [0, 1].
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
    drift: float = 0.03
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
        _check(self, ("slip", "drift"))


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
class VerdictConfig:
    """Limits of a good map.

    Parameters
    ----------
    unmatched, unmatched_blind, hopeless_unmatched
        Fraction of unmatched scans above which a map is doubtful, the same where no odometry tells
        the motion, and that above which it is none, [0, 1].
    ambiguous
        Fraction of ambiguous scans above which a map is doubtful, [0, 1].
    elsewhere, hopeless_elsewhere
        Fraction of places passed again that fit better elsewhere, above which a map is doubtful,
        and above which it is none, [0, 1].
    contradicted_places
        Fraction of places passed again that contradict what was seen there before, above which an
        edited map is doubtful, [0, 1]: on five public logs 0 to 0.06 of a right map, 0.24 of halves
        put together wrongly, 0.68 to 0.92 with loops left open.
    fewest
        Number of such places below which nothing follows from them, >= 1.
    contradicted_m
        Distance on which odometry contradicts the scans, without a break [m], > 0.
    contradicted
        Fraction of the distance on which it may do so with breaks, [0, 1].
    ratio
        Difference of a ratio of odometry and scans from 1, > 0.
    yaw_rad
        Direction of the motion by scans from that by odometry [rad], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    unmatched: float = 0.01
    unmatched_blind: float = 0.005
    hopeless_unmatched: float = 0.2
    ambiguous: float = 0.04
    elsewhere: float = 0.05
    hopeless_elsewhere: float = 0.25
    contradicted_places: float = 0.15
    fewest: int = 3
    contradicted_m: float = 3.0
    contradicted: float = 0.03
    ratio: float = 0.12
    yaw_rad: float = 0.35

    def __post_init__(self) -> None:
        _check(
            self,
            (
                "unmatched",
                "unmatched_blind",
                "hopeless_unmatched",
                "ambiguous",
                "elsewhere",
                "hopeless_elsewhere",
                "contradicted_places",
                "contradicted",
            ),
        )


@dataclass(frozen=True, slots=True)
class SlamTuning:
    """Thresholds of SLAM's stages, in the order in which a scan passes them.

    Parameters
    ----------
    tracking
        Registration of scans.
    hypotheses, trust
        Registration without odometry, and when odometry is not believed.
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
    verdict
        What counts as a good map.
    """

    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    trust: TrustConfig = field(default_factory=TrustConfig)
    known: KnownPlacesConfig = field(default_factory=KnownPlacesConfig)
    links: LinkConfig = field(default_factory=LinkConfig)
    walls: StraightWallsConfig = field(default_factory=StraightWallsConfig)
    shapes: ShapeConfig = field(default_factory=ShapeConfig)
    loops: LoopClosureConfig = field(default_factory=LoopClosureConfig)
    verification: VerificationConfig = field(default_factory=VerificationConfig)
    images: VisualConfig = field(default_factory=VisualConfig)
    relocalisation: RelocalisationConfig = field(default_factory=RelocalisationConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)
