"""Settings of the ground-plane camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from robotctl.config_values import check_ranges
from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class FloorLookConfig:
    """When the colours of the free patch are those of the floor, see `judge_patch`.

    Parameters
    ----------
    overexposed_above, dark_below
        Level above which the darkest channel of a colour is overexposed, and below which the
        brightest one is too dark, 0 to 255.
    blind_share
        Share of such colours above which the patch is not judged, 0 to 1.
    colour_share_min
        Share of the rest of the patch from which on a colour is learned, 0 to 0.5.
    part_share_min
        Share of a part that must have colours of the rest for the part to be floor, 0 to 1.
    misfits
        Number of the nine parts that are not floor at which nothing is learned, 1 to 10.
    familiar_min
        Overlap of the patch with the known floor below which it is another floor, or none, 0 to 1.
    above_alike_max
        Overlap of what is above the horizon with the floor above which nothing is judged, 0 to 1.
    learn_every
        Pictures from one that a known floor is learned from to the next, 1 to 1000.
    exposure_max_bins
        Maximum change of exposure between two pictures that the floor follows [bins of 7 %], 0
        to 50.
    exposure_agrees_bins
        Maximum difference between the patch's and the whole picture's change of brightness [bins]
        for it to be one of exposure, 0 to 50: an obstacle of the floor's colour changes the patch
        alone.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    overexposed_above: float = 250.0
    dark_below: float = 10.0
    blind_share: float = 0.5
    colour_share_min: float = 0.01
    part_share_min: float = 0.5
    misfits: int = 4
    familiar_min: float = 0.3
    above_alike_max: float = 0.6
    learn_every: int = 4
    exposure_max_bins: int = 10
    exposure_agrees_bins: float = 2.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            overexposed_above=(0.0, 255.0),
            dark_below=(0.0, 255.0),
            blind_share=(0.0, 1.0),
            colour_share_min=(0.0, 0.5),
            part_share_min=(0.0, 1.0),
            misfits=(1, 10),
            familiar_min=(0.0, 1.0),
            above_alike_max=(0.0, 1.0),
            learn_every=(1, 1000),
            exposure_max_bins=(0, 50),
            exposure_agrees_bins=(0.0, 50.0),
        )


@dataclass(frozen=True, slots=True)
class BoundaryConfig:
    """How the end of the floor is found in each column of the picture, see `find_boundary`.

    Evidence is the natural logarithm of how much more likely an obstacle is than floor.

    Parameters
    ----------
    evidence_min
        Mean evidence over two coarse rows and three columns that makes an obstacle, 0 to 3: larger,
        fewer false obstacles and later true ones.
    wall_rows
        Coarse rows above the horizon from which evidence for a wall is summed downwards, 1 to 100.
    wall_evidence_min
        Sum of evidence that makes a wall, 0 to 100.
    wall_doubt
        Evidence in a row below which a wall does not continue, 0 to 1.5.
    foot_leap_rows
        Maximum rows by which the foot of a wall may lie below that of the columns about it, 0
        to 100.
    free_differs_min
        Share of a column above the horizon that must differ from floor for the column to be free,
        0 to 1.
    neighbour_evidence_min
        Evidence of a cell from which on it may cast the shadow beside it, 0 to 3.
    sharp_bins
        Step in brightness [bins of 7 %] between a small blob of the floor's colour and the floor
        from which on it is no change of light, 0 to 50.
    caster_share
        Share of a shadow that what casts it must cover, 0 to 10.
    thing_evidence
        Evidence that a blob gets which no light explains, 0 to 3.
    edge_rows
        Maximum rows to either side over which the lens spreads a step in colour, 1 to 50.
    flat_rows
        Rows beyond those that give the colours before and behind the step, 1 to 50.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    evidence_min: float = 0.7
    wall_rows: int = 3
    wall_evidence_min: float = 2.0
    wall_doubt: float = 0.15
    foot_leap_rows: float = 1.0
    free_differs_min: float = 0.6
    neighbour_evidence_min: float = 0.5
    sharp_bins: float = 5.0
    caster_share: float = 0.5
    thing_evidence: float = 1.5
    edge_rows: int = 3
    flat_rows: int = 4

    def __post_init__(self) -> None:
        check_ranges(
            self,
            evidence_min=(0.0, 3.0),
            wall_rows=(1, 100),
            wall_evidence_min=(0.0, 100.0),
            wall_doubt=(0.0, 1.5),
            foot_leap_rows=(0.0, 100.0),
            free_differs_min=(0.0, 1.0),
            neighbour_evidence_min=(0.0, 3.0),
            sharp_bins=(0.0, 50.0),
            caster_share=(0.0, 10.0),
            thing_evidence=(0.0, 3.0),
            edge_rows=(1, 50),
            flat_rows=(1, 50),
        )


@dataclass(frozen=True, slots=True)
class ObjectsConfig:
    """Which parts of the boundary are single objects, see `find_obstacles`.

    Parameters
    ----------
    gap_share
        Step in range within one object, as a share of the range beside `obstacle_gap_m`, 0 to 1.
    bridged_columns
        Columns without a matching range that do not split an object, 0 to 100.
    columns_min
        Minimum columns of an object, 1 to 100.
    beside_columns
        Columns beside an object that are asked for floor behind it, 1 to 100.
    behind_columns
        Number of these that must show floor there, at most `beside_columns`.
    evidence_min
        Minimum mean evidence of an object, 0 to 3.
    indistinct_width_m
        Minimum width of an object that resembles the wall and hardly differs from the floor [m], 0
        to 10.
    depth_sigma
        Standard deviation of an object's middle along the line of sight, as a share of its width, 0
        to 10: it is assumed as deep as it is wide.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    gap_share: float = 0.03
    bridged_columns: int = 2
    columns_min: int = 2
    beside_columns: int = 8
    behind_columns: int = 3
    evidence_min: float = 1.0
    indistinct_width_m: float = 0.15
    depth_sigma: float = 0.25

    def __post_init__(self) -> None:
        check_ranges(
            self,
            gap_share=(0.0, 1.0),
            bridged_columns=(0, 100),
            columns_min=(1, 100),
            beside_columns=(1, 100),
            behind_columns=(1, self.beside_columns),
            evidence_min=(0.0, 3.0),
            indistinct_width_m=(0.0, 10.0),
            depth_sigma=(0.0, 10.0),
        )


@dataclass(frozen=True, slots=True)
class GroundCameraConfig:
    """Settings to distinguish floor from objects, and their trust.

    Parameters
    ----------
    patch_near_m
        Distance of the free patch, from which the floor's look is learnt, from the nearest floor in
        the picture [m]. Anything nearer is not judged, which hides the robot's own bumper.
    patch_depth_m
        How far the free patch reaches from there [m].
    patch_near_width_m
        Width of the free patch at its near side [m].
    patch_far_width_m
        Width of the free patch at its far side [m].
    adaption
        Share of the floor model that one picture replaces, (0, 1].
    max_range_m
        Maximum range [m].
    beams
        Beams of the range scan, evenly over the picture's width.
    least_height_m
        Lower objects are ignored [m].
    least_width_m
        Narrower objects are ignored [m].
    boundary_sigma_px
        Standard deviation of a boundary in the picture [px].
    pitch_sigma_deg
        Standard deviation of the robot's pitch while it drives [deg].
    calibration_sigma_deg
        Standard deviation of the calibrated angles of the camera [deg].
    height_sigma
        Standard deviation of the camera's calibrated height, as a share of it.
    obstacle_range_m
        Maximum range for single obstacles [m].
    obstacle_gap_m
        Step in range that ends an obstacle [m].
    obstacle_width_m
        A wider object is a wall [m].
    together_share
        Difference in range, as a share of it, within which columns of one beam see one thing, 0
        to 1.
    floor, boundary, objects
        When the floor's look is learnt, where the floor ends, and what stands on it by itself.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    patch_near_m: float = 0.02
    patch_depth_m: float = 0.4
    patch_near_width_m: float = 0.3
    patch_far_width_m: float = 0.4
    adaption: float = 0.05
    max_range_m: float = 4.0
    beams: int = 80
    least_height_m: float = 0.04
    least_width_m: float = 0.04
    boundary_sigma_px: float = 0.7
    pitch_sigma_deg: float = 0.1
    calibration_sigma_deg: float = 0.05
    height_sigma: float = 0.005
    obstacle_range_m: float = 2.5
    obstacle_gap_m: float = 0.1
    obstacle_width_m: float = 1.2
    together_share: float = 0.1
    floor: FloorLookConfig = field(default_factory=FloorLookConfig)
    boundary: BoundaryConfig = field(default_factory=BoundaryConfig)
    objects: ObjectsConfig = field(default_factory=ObjectsConfig)

    def __post_init__(self) -> None:
        check_ranges(self, together_share=(0.0, 1.0))
        for key in ("patch_near_m", "pitch_sigma_deg", "calibration_sigma_deg", "height_sigma"):
            self._check(key, -1e-12, 10.0)
        for key in (
            "patch_depth_m",
            "patch_near_width_m",
            "patch_far_width_m",
            "obstacle_gap_m",
            "obstacle_width_m",
            "obstacle_range_m",
        ):
            self._check(key, 0.0, 10.0)
        self._check("max_range_m", 0.1, 100.0)
        self._check("least_height_m", 0.001, 1.0)
        self._check("least_width_m", 0.001, 1.0)
        self._check("boundary_sigma_px", 0.0, 50.0)
        if not 0.0 < self.adaption <= 1.0:
            raise InvalidValue(
                "adaption", f"must lie in (0, 1], found {self.adaption}", self.adaption
            )
        if not 1 <= self.beams <= 10_000:
            raise InvalidValue("beams", f"must be 1 to 10000, found {self.beams}", self.beams)

    def _check(self, key: str, above: float, below: float) -> None:
        """Refuse a value that is not strictly between two bounds."""
        value = getattr(self, key)
        if not (math.isfinite(value) and above < value < below):
            low = 0 if above < 0.0 else above
            raise InvalidValue(key, f"must lie between {low:g} and {below:g}, found {value}", value)
