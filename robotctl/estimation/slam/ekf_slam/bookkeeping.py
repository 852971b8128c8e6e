"""Which landmark is seen: by its name, or by where it is; and which landmarks are worth keeping.

Without names a landmark is on trial until it was seen `sightings` times. One that is not by
`trial_ns` after it was seen first was an error of association or of the sensor, and is removed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.ekf_slam.association import NONE
from robotctl.estimation.slam.ekf_slam.features import FeatureKind
from robotctl.estimation.slam.ekf_slam.filter import NEW, EkfSlam

Array: TypeAlias = NDArray[np.float64]
Association: TypeAlias = Literal["names", "joint", "nearest"]

ASSOCIATIONS: Final[tuple[Association, ...]] = ("names", "joint", "nearest")


@dataclass(slots=True)
class LandmarkBook:
    """Names of landmarks, how often each was seen, and since when.

    Parameters
    ----------
    association
        `names` where the sensor tells them, else a method of `EkfSlam.associate`.
    sightings, trial_ns
        See above.
    """

    association: Association
    sightings: int = 3
    trial_ns: int = 30_000_000_000
    counts: dict[int | str, int] = field(default_factory=dict)
    unused: int = 0
    """Sightings that might have been of several landmarks."""
    _first_ns: dict[int | str, int] = field(default_factory=dict)
    _made: int = 0

    def which(
        self, slam: EkfSlam, kind: FeatureKind, z: Array, R: Array, names: list[int]
    ) -> NDArray[np.int64]:
        """Return of which feature each measurement (m, 2) is, `NEW` or `NONE`, (m,)."""
        if self.association != "names":
            return slam.associate(kind, z, R, self.association)
        known = [slam.index(name) for name in names]
        found = np.array([NEW if each is None else each for each in known])
        for a, name in enumerate(names):
            if name in names[:a]:  # seen twice at once: the first is added or counts
                found[a] = NONE
        return found

    def name(self, name: int) -> int | str:
        """Return the name of a new landmark: its own, or the next number."""
        if self.association == "names":
            return name
        self._made += 1
        return self._made

    def saw(self, name: int | str, stamp_ns: int) -> None:
        """Count a sighting of a landmark at a time [ns]."""
        self.counts[name] = self.counts.get(name, 0) + 1
        self._first_ns.setdefault(name, stamp_ns)

    def prune(self, slam: EkfSlam, stamp_ns: int) -> None:
        """Remove the landmarks that were on trial for too long at a time [ns]."""
        if self.association == "names":
            return
        for name, first_ns in list(self._first_ns.items()):
            if self.counts[name] >= self.sightings:
                del self._first_ns[name]
            elif stamp_ns - first_ns > self.trial_ns:
                del self._first_ns[name], self.counts[name]
                slam.remove(slam.names.index(name))
