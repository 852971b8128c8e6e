"""Settings of recognition by images; without numpy, for all that read a robot's file."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.config_values import check_ranges
from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class VisualConfig:
    """When an image shows the same place as another.

    Parameters
    ----------
    candidates
        Number of images whose geometry is compared, those of the highest score, >= 1.
    least_features
        Minimum number of features of an image that can be recognised, >= 8; a plain wall has fewer.
    least_score
        Minimum score of a candidate as a fraction of the best one's, [0, 1].
    log10_chance
        Maximum log10 of the probability that a fit is chance, [-300, 0).
    least_share
        Minimum share of an image's features that must fit, [0, 1]: doors and lamps elsewhere that
        look alike are fewer.
    alone_share
        Minimum share that counts without confirmation by the images before, [0, 1].
    few
        Number of features below which shares are of this many, >= 1.
    rival
        Share of the best fit from which another place makes it ambiguous, [0, 1].
    near
        Number of images before and after one that show the same place, at least, >= 0.
    remembered
        Number of images before the last whose candidates confirm its own, >= 0.
    alike
        Score from which two images are much the same, [0, 1]: of a camera that stands or creeps.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    candidates: int = 5
    least_features: int = 50
    least_score: float = 0.5
    log10_chance: float = -6.0
    least_share: float = 0.1
    alone_share: float = 0.2
    few: int = 100
    rival: float = 0.6
    near: int = 3
    remembered: int = 3
    alike: float = 0.4

    def __post_init__(self) -> None:
        leasts = {"candidates": 1, "least_features": 8, "few": 1, "near": 0, "remembered": 0}
        check_ranges(self, **{key: (least, math.inf) for key, least in leasts.items()})
        shares = ("least_score", "least_share", "alone_share", "rival", "alike")
        check_ranges(self, **dict.fromkeys(shares, (0.0, 1.0)))
        chance = self.log10_chance
        if not -300.0 <= chance < 0.0:
            raise InvalidValue("log10_chance", f"{chance} found, -300 to below 0 allowed", chance)
