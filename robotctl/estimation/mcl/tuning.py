"""Settings of the particles in a robot's file; without numpy, for every process that reads it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from robotctl.config_values import check_ranges
from robotctl.errors import InvalidValue

_MOST_PARTICLES: Final = 10_000_000
_MOST_MEASUREMENTS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """When measurements of a tracked robot call its place in question, see `LikelihoodMonitor`.

    Parameters
    ----------
    memory
        Measurements over which level and scatter of the fit are averaged, 1 to 1e6.
    prior_measurements
        Weight of the initial level and scatter, in measurements, 0 to 1e6.
    scatter_min
        Least scatter that is assumed [nat], 0.01 to 100.
    slack
        Standard deviations below the level that count as nothing, 0 to 10.
    clip
        Maximum weight of one measurement [standard deviations], 0.1 to 100.
    learning_clip
        Maximum change of level and scatter by one measurement [standard deviations], 0 to 100, so
        that a bad fit is noticed before it is learnt.
    alarm
        Sum of standard deviations, less the slack, at which the fit is bad if both the evidence and
        its advantage over poses anywhere fell, 0 to 1e6.
    alarm_alone
        Sum at which it is bad if the evidence alone fell, 0 to 1e6. On public lidar logs that of a
        tracked robot reaches 22.
    calm
        Sum of the advantage below which a sensor has nothing against the place, 0 to 1e6: a robot
        that was moved by hand exceeds 1 with the first measurement.
    calm_evidence
        The same of the evidence, which falls in a crowd, 0 to 1e6.
    says_more
        A sensor overrules another one if its measurements usually favour the place by this factor
        more, 1 to 100.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    memory: int = 100
    prior_measurements: int = 20
    scatter_min: float = 0.5
    slack: float = 1.0
    clip: float = 4.0
    learning_clip: float = 2.0
    alarm: float = 8.0
    alarm_alone: float = 40.0
    calm: float = 1.0
    calm_evidence: float = 4.0
    says_more: float = 1.5

    def __post_init__(self) -> None:
        check_ranges(
            self,
            memory=(1, _MOST_MEASUREMENTS),
            prior_measurements=(0, _MOST_MEASUREMENTS),
            scatter_min=(0.01, 100.0),
            slack=(0.0, 10.0),
            clip=(0.1, 100.0),
            learning_clip=(0.0, 100.0),
            alarm=(0.0, 1e6),
            alarm_alone=(0.0, 1e6),
            calm=(0.0, 1e6),
            calm_evidence=(0.0, 1e6),
            says_more=(1.0, 100.0),
        )


@dataclass(frozen=True, slots=True)
class RivalConfig:
    """Evidence by which another place replaces the tracked one, see `Rival`.

    Parameters
    ----------
    lead
        Log-evidence by which it must lead [nat], 0 to 1000.
    travel_min_m, turn_min_rad
        Distance [m] or turns [rad] over which it must lead, 0 to 100.
    measurements_min
        Measurements over which it must lead, 0 to 1000.
    clip
        Maximum weight of one measurement [nat], 0.1 to 1000.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    lead: float = 10.0
    travel_min_m: float = 0.5
    turn_min_rad: float = 0.5
    measurements_min: int = 4
    clip: float = 10.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            lead=(0.0, 1000.0),
            travel_min_m=(0.0, 100.0),
            turn_min_rad=(0.0, 100.0),
            measurements_min=(0, 1000),
            clip=(0.1, 1000.0),
        )


@dataclass(frozen=True, slots=True)
class SearchConfig:
    """Searches of the whole map.

    Parameters
    ----------
    particles_per_m2
        Random poses that a search begins with for each m2 in which the robot can be, 1 to 10 000:
        in a warehouse of 1280 m2 16 lost the right place in 2 of 10 searches, 50 in none.
    particles_min, particles_max
        Bounds of that number, 1000 to 1e7. The least is also that of the particles that go on from
        the best places. A million poses take about 0.5 s of processor time, in steps, and no more
        memory than a few.
    poses_per_step
        Poses weighed in a step of navigation, 100 to 1e7; the rest of the measurement waits for the
        next step, so that navigation stays awake.
    symmetry_min
        Share of the walls that fall on walls after a turn and shift, from which that counts as a
        symmetry of the map, 0.05 to 1.
    alike_within
        Log-likelihood per measurement below the best within which another place is a look-alike
        [nat], 0 to 100; odometry blurs both.
    apart_m, apart_rad
        Distance [m] or angle [rad] from which poses are different places, 0.01 to 10.
    fit_min
        Mean log-likelihood below which no place fits, so that the map is the wrong one [nat],
        -1000 to 0: -13 to -24 on maps of other buildings, -10 and more on the right one.
    fit_measurements
        Measurements from which that mean counts, 1 to 1000.
    fit_memory
        Measurements over which it is averaged, 1 to 1000.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    particles_per_m2: float = 50.0
    particles_min: int = 20_000
    particles_max: int = 5_000_000
    poses_per_step: int = 10_000
    symmetry_min: float = 0.35
    alike_within: float = 1.0
    apart_m: float = 0.5
    apart_rad: float = 0.3
    fit_min: float = -11.0
    fit_measurements: int = 10
    fit_memory: int = 20

    def __post_init__(self) -> None:
        check_ranges(
            self,
            particles_per_m2=(1.0, 10_000.0),
            particles_min=(1000, _MOST_PARTICLES),
            particles_max=(1000, _MOST_PARTICLES),
            poses_per_step=(100, _MOST_PARTICLES),
            symmetry_min=(0.05, 1.0),
            alike_within=(0.0, 100.0),
            apart_m=(0.01, 10.0),
            apart_rad=(0.01, 10.0),
            fit_min=(-1000.0, 0.0),
            fit_measurements=(1, 1000),
            fit_memory=(1, 1000),
        )
        if self.particles_min > self.particles_max:
            raise InvalidValue(
                "particles_min",
                f"{self.particles_min} found, at most particles_max ({self.particles_max}) allowed",
                self.particles_min,
            )


@dataclass(frozen=True, slots=True)
class MclTuning:
    """How particles are weighed and judged, whatever their number.

    Parameters
    ----------
    update_min_m, update_min_rad
        Measurements are used after this distance [m] or turn [rad], 0 to 100: others add little.
    kld_error, kld_quantile
        Error of the distribution that the number of particles allows, and the quantile of the
        normal distribution with which it is kept, see `kld_bound`; 0.001 to 1, and 0.1 to 10.
    resample_below
        Resample when the effective size falls below this share of the particles, 0.01 to 0.99.
    n_eff_floor
        A tracked robot's measurements are tempered so that at least this share of the particles
        stays effective, 1e-6 to 0.99.
    uniform_probes
        Random poses that a tracked robot's measurements are compared with, as a share of the
        particles, 0.001 to 0.99.
    carried_away
        Probability that the robot was carried away between two measurements, 1e-12 to 0.49.
    search_floor
        Share of the effective particles that stay so in each step of a search, 0.01 to 0.99.
    random_injection
        Random poses that a search adds before each measurement, for places that it overlooked: as
        a share of the particles that it begins with, and of the belief, 0.001 to 0.99.
    localised_m, localised_rad
        Greatest standard deviations of a localised robot [m], [rad], 0.001 to 100.
    localised_weight
        Least share of the belief in its cluster, 0.01 to 0.99.
    tracked_m
        Standard deviation up to which a robot that was localised goes on by odometry, unless
        something speaks against its place [m], at least `localised_m`, at most 100: along a
        corridor sonars tell nothing.
    localised_updates
        Consecutive measurements needed, 1 to 1000.
    blind_s
        Time to wait for measurements before the particles move on without [s], 0 to 2; sensors'
        arrive within a tenth of the default.
    monitor, rival, search
        When a tracked place is in question, what another one must prove, and how the map is
        searched.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    update_min_m: float = 0.1
    update_min_rad: float = 0.1
    kld_error: float = 0.05
    kld_quantile: float = 2.33
    resample_below: float = 0.5
    n_eff_floor: float = 0.01
    uniform_probes: float = 0.1
    carried_away: float = 1e-4
    search_floor: float = 0.3
    random_injection: float = 0.1
    localised_m: float = 0.3
    localised_rad: float = 0.2
    localised_weight: float = 0.9
    localised_updates: int = 5
    tracked_m: float = 1.0
    blind_s: float = 0.5
    monitor: MonitorConfig = field(default_factory=MonitorConfig)
    rival: RivalConfig = field(default_factory=RivalConfig)
    search: SearchConfig = field(default_factory=SearchConfig)

    def __post_init__(self) -> None:
        check_ranges(
            self,
            update_min_m=(0.0, 100.0),
            update_min_rad=(0.0, 100.0),
            kld_error=(0.001, 1.0),
            kld_quantile=(0.1, 10.0),
            resample_below=(0.01, 0.99),
            n_eff_floor=(1e-6, 0.99),
            uniform_probes=(0.001, 0.99),
            carried_away=(1e-12, 0.49),
            search_floor=(0.01, 0.99),
            random_injection=(0.001, 0.99),
            localised_m=(0.001, 100.0),
            localised_rad=(0.001, 100.0),
            localised_weight=(0.01, 0.99),
            localised_updates=(1, 1000),
            tracked_m=(0.001, 100.0),
            blind_s=(0.0, 2.0),
        )
        if self.tracked_m < self.localised_m:
            raise InvalidValue(
                "tracked_m",
                f"{self.tracked_m} found, at least localised_m ({self.localised_m}) allowed",
                self.tracked_m,
            )
