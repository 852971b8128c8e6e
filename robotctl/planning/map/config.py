"""Settings of the live map in a robot's file; without numpy, for every process that reads it."""

from __future__ import annotations

from dataclasses import dataclass, field

from robotctl.config_values import check_ranges
from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class TracksConfig:
    """How moving obstacles are found and tracked, see `MovingObstacles`.

    Parameters
    ----------
    range_m
        Maximum range at which motion is judged [m], 0.5 to 100: farther out, beams lie too far
        apart.
    compare_s
        Age of the scan that a new one is compared with [s], 0.1 to 1: a slow person has moved by
        then.
    margin_m
        Difference that makes another range [m], 0.01 to 1: more than noise, less than a slow person
        walks in half a second.
    free_scans
        Earlier scans that must have seen through a place before something came there, 1 to 10.
    person_width_m
        Maximum width of a piece of a scan that may be a person or another robot [m], 0.1 to 10.
    leg_width_m
        Maximum width of a piece that may be a leg [m], 0.02 to 1.
    stride_m
        Maximum distance between two legs of one person [m], 0 to 2.
    radius_min_m
        Minimum radius of a moving obstacle [m], 0.01 to 5.
    acceleration
        Standard deviation of an obstacle's acceleration, times the root of a second [m/s^1.5], 0.01
        to 10: larger, velocities follow faster and are noisier.
    gate_m
        Maximum distance of a segment from its track, beside three standard deviations [m], 0.01
        to 5.
    surprise_sigmas
        Standard deviations off its expected place from which an obstacle has changed its velocity,
        1 to 100.
    speed_sigma_m_s
        Standard deviation of the velocity of a new track [m/s], 0.1 to 20.
    speed_min_m_s
        Minimum speed of a moving thing [m/s], 0.01 to 5.
    certain_sigmas
        Standard deviations that a velocity must be from 0 to count, 0 to 20.
    vague_m_s
        Standard deviation of a velocity above which it says nothing [m/s], 0.01 to 10.
    proofs
        Scans in which a track must have points that came lately before it counts as moving, 1
        to 20.
    proven_s
        Time for which such a proof lasts [s], 0.1 to 60.
    lost_s
        Time without a segment after which a track ends [s], 0.05 to 60.
    turn_s
        Time for which who turns is expected to turn on, 0 to 3 [s], such as 1, which makes up for
        the lag of the tracks, too: larger, more of a turn is foreseen; 0: everybody goes straight
        on.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    range_m: float = 8.0
    compare_s: float = 0.3
    margin_m: float = 0.1
    free_scans: int = 2
    person_width_m: float = 1.0
    leg_width_m: float = 0.25
    stride_m: float = 0.6
    radius_min_m: float = 0.2
    acceleration: float = 0.2
    gate_m: float = 0.25
    surprise_sigmas: float = 3.0
    speed_sigma_m_s: float = 1.5
    speed_min_m_s: float = 0.15
    certain_sigmas: float = 2.0
    vague_m_s: float = 0.35
    proofs: int = 2
    proven_s: float = 1.0
    lost_s: float = 0.5
    turn_s: float = 0.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            range_m=(0.5, 100.0),
            compare_s=(0.1, 1.0),
            margin_m=(0.01, 1.0),
            free_scans=(1, 10),
            person_width_m=(0.1, 10.0),
            leg_width_m=(0.02, 1.0),
            stride_m=(0.0, 2.0),
            radius_min_m=(0.01, 5.0),
            acceleration=(0.01, 10.0),
            gate_m=(0.01, 5.0),
            surprise_sigmas=(1.0, 100.0),
            speed_sigma_m_s=(0.1, 20.0),
            speed_min_m_s=(0.01, 5.0),
            certain_sigmas=(0.0, 20.0),
            vague_m_s=(0.01, 10.0),
            proofs=(1, 20),
            proven_s=(0.1, 60.0),
            lost_s=(0.05, 60.0),
            turn_s=(0.0, 3.0),
        )


@dataclass(frozen=True, slots=True)
class MapConfig:
    """Marks of sensors in the live map, and how long it remembers them.

    Parameters
    ----------
    decay_s
        Time without being seen again after which a mark is forgotten [s], 0.1 to 86400.
    unmapped_decay_s
        The same where the robot has no map, and nothing else tells of walls behind it [s], 0.1 to
        86400.
    lidar_range_m
        Maximum range at which a lidar's points are marked [m], 0.5 to 100.
    agree_m
        Distance from an obstacle of the map within which a point is that obstacle [m], 0 to 1:
        larger, an error of the pose makes walls no thicker, but what stands at a wall is not seen.
    agree_per_m
        The same per metre of range, as the heading errs, 0 to 0.5.
    moving_margin_m
        Distance from a moving obstacle's circle within which points belong to it [m], 0 to 1.
    sonar_beam_deg
        Opening of a sonar's cone, from edge to edge [deg], 1 to 90.
    sonar_free_m
        Maximum range at which a sonar clears [m], 0 to 20: its cone is wide beyond.
    no_echo_m
        Range that a sonar without an echo clears [m], 0 to 20: smooth walls at an angle return
        none.
    sonar_band_m
        Half the depth of the arc that a sonar's echo marks [m], 0.005 to 0.5.
    stood_s
        Time after which an echo from one place counts as a standing thing [s], 0 to 60.
    new_echoes
        Echoes in a row that show something new, 1 to 20: one alone may have nothing to do with the
        world.
    blind_s
        Maximum age of the last scan with which a robot that has a lidar drives [s], 0.05 to 5.
    person_range_m
        Maximum distance at which a person counts as near [m], 0 to 20.
    recent_s
        Age up to which an obstacle counts as still seen [s], 0.05 to 60.
    view_m
        Half the side of the map that the local controller gets [m], 1 to 20: steps take longer with
        more of it.
    cell_m
        Side of a cell of a map that is drawn from walls, or that the robot without one makes itself
        [m], 0.01 to 0.5. What is narrower than the body and two cells may be taken for closed;
        smaller cells take more time, and each some 80 bytes.
    around_m
        Margin of such a map around goals, and around the robot whenever it comes near the edge [m],
        at least `lidar_range_m`, at most 200.
    tracks
        Moving obstacles.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    decay_s: float = 30.0
    unmapped_decay_s: float = 86400.0
    lidar_range_m: float = 10.0
    agree_m: float = 0.1
    agree_per_m: float = 0.015
    moving_margin_m: float = 0.15
    sonar_beam_deg: float = 25.0
    sonar_free_m: float = 2.5
    no_echo_m: float = 1.0
    sonar_band_m: float = 0.05
    stood_s: float = 1.0
    new_echoes: int = 2
    blind_s: float = 0.5
    person_range_m: float = 2.0
    recent_s: float = 1.0
    view_m: float = 4.0
    cell_m: float = 0.05
    around_m: float = 20.0
    tracks: TracksConfig = field(default_factory=TracksConfig)

    def __post_init__(self) -> None:
        check_ranges(
            self,
            decay_s=(0.1, 86400.0),
            unmapped_decay_s=(0.1, 86400.0),
            lidar_range_m=(0.5, 100.0),
            agree_m=(0.0, 1.0),
            agree_per_m=(0.0, 0.5),
            moving_margin_m=(0.0, 1.0),
            sonar_beam_deg=(1.0, 90.0),
            sonar_free_m=(0.0, 20.0),
            no_echo_m=(0.0, 20.0),
            sonar_band_m=(0.005, 0.5),
            stood_s=(0.0, 60.0),
            new_echoes=(1, 20),
            blind_s=(0.05, 5.0),
            person_range_m=(0.0, 20.0),
            recent_s=(0.05, 60.0),
            view_m=(1.0, 20.0),
            cell_m=(0.01, 0.5),
            around_m=(0.5, 200.0),
        )
        if self.around_m < self.lidar_range_m:
            raise InvalidValue(
                "around_m",
                f"{self.around_m} found, at least lidar_range_m ({self.lidar_range_m}) allowed",
                self.around_m,
            )
