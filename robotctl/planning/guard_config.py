"""Settings of what the guard remembers and expects; without numpy, for all that read a file."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.config_values import check_ranges


@dataclass(frozen=True, slots=True)
class GuardMemoryConfig:
    """How long the guard keeps what is out of sight.

    Parameters
    ----------
    life_s
        Age at which an echo or a point of a lidar is forgotten [s], 0.5 to 3600: it may have been a
        person.
    echo_range_m
        Maximum range of an echo that is kept [m], 0.05 to 5: farther out the sonar's axis lies too
        far off.
    echo_kept_m
        Distance from `base` beyond which it is forgotten [m], 0.1 to 10.
    echo_same_m
        Maximum distance between two echoes in a row of one thing [m], 0.005 to 1.
    echo_beyond_m
        Distance behind a kept echo from which on another one shows that nothing is there [m], 0.005
        to 1.
    scan_reach_m
        Distance from `base` up to which points of a lidar matter [m], 0.1 to 10.
    scan_kept_m
        Distance from `base` beyond which they are forgotten [m], 0.1 to 20. A robot that backs
        round in a circle comes back to what it has seen, tail first: the diameter of the tightest
        circles is 1 m.
    scan_same_m
        Distance before a point from which on a beam ends at something else [m], 0.005 to 1.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    life_s: float = 20.0
    echo_range_m: float = 0.8
    echo_kept_m: float = 1.2
    echo_same_m: float = 0.08
    echo_beyond_m: float = 0.15
    scan_reach_m: float = 1.0
    scan_kept_m: float = 2.5
    scan_same_m: float = 0.05

    def __post_init__(self) -> None:
        check_ranges(
            self,
            life_s=(0.5, 3600.0),
            echo_range_m=(0.05, 5.0),
            echo_kept_m=(0.1, 10.0),
            echo_same_m=(0.005, 1.0),
            echo_beyond_m=(0.005, 1.0),
            scan_reach_m=(0.1, 10.0),
            scan_kept_m=(0.1, 20.0),
            scan_same_m=(0.005, 1.0),
        )


@dataclass(frozen=True, slots=True)
class ApproachConfig:
    """Thresholds for something that approaches by itself, as a sonar hears it; see `EchoMotion`.

    Parameters
    ----------
    forgets_s
        Time in which a wrong speed fades [s], 0.01 to 5: shorter, it follows faster and is noisier.
    jump_m
        Distance off the expected range from which on a reading is of something else [m], 0.01 to 2.
    silence_s
        Time without a reading after which the speed is unknown [s], 0.05 to 5.
    readings
        Readings after which a speed counts, 2 to 100.
    speed_min_m_s
        Minimum closing speed of a moving thing [m/s], 0.01 to 2: the readings are noisy.
    walk_m_s
        Assumed speed of what may move [m/s], 0 to 3.
    hidden_s
        Time for which a person who came nearer and left the beam may stand between two beams [s], 0
        to 60.
    beside_s
        The same for one who left it close to the robot, and may have stopped there [s], 0 to 60.
    hidden_m
        Range beyond which a person who leaves one beam enters another [m], 0 to 10.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    forgets_s: float = 0.12
    jump_m: float = 0.2
    silence_s: float = 0.3
    readings: int = 4
    speed_min_m_s: float = 0.2
    walk_m_s: float = 0.8
    hidden_s: float = 1.0
    beside_s: float = 3.0
    hidden_m: float = 1.5

    def __post_init__(self) -> None:
        check_ranges(
            self,
            forgets_s=(0.01, 5.0),
            jump_m=(0.01, 2.0),
            silence_s=(0.05, 5.0),
            readings=(2, 100),
            speed_min_m_s=(0.01, 2.0),
            walk_m_s=(0.0, 3.0),
            hidden_s=(0.0, 60.0),
            beside_s=(0.0, 60.0),
            hidden_m=(0.0, 10.0),
        )


@dataclass(frozen=True, slots=True)
class NearPeopleConfig:
    """How fast the robot drives near people, whatever wants it to.

    Parameters
    ----------
    near_m
        Gap between the body and what moves, or may move, below which the robot is slow [m], 0 to
        10; 0: it is not.
    speed_m_s
        Its maximum speed there [m/s], 0.05 to 2; it brakes before somebody is that near.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    near_m: float = 0.0
    speed_m_s: float = 0.3

    def __post_init__(self) -> None:
        check_ranges(self, near_m=(0.0, 10.0), speed_m_s=(0.05, 2.0))
