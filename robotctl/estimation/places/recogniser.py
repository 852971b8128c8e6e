"""The port of place recognition: what the robot senses, and which known places it may be of.

| what is sensed | recogniser | its places |
|---|---|---|
| echoes of a turn on the spot | `database.PlaceBook` | named places |
| an image | `visual.recognition.VisualPlaces` | images, by number |
| the shape of the surroundings | `slam.keyframes.shapes.Shapes` | keyframes, by number |
| a scan, on a topological map | `planning.map.topological.recognition.PlaceSearch` | named places |

A suggestion is a hint. SLAM verifies each by scans (`slam.keyframes.verification`) and closes a
loop where two agree; particles weigh it (`fix`); the topological map compares what its views see.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from robotctl.model.geometry.se2 import SE2

PlaceT = TypeVar("PlaceT")
CandidateT = TypeVar("CandidateT", bound="Candidate[Any]")
SensedT_contra = TypeVar("SensedT_contra", contravariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate(Generic[PlaceT]):
    """A known place where the robot may be.

    Parameters
    ----------
    place
        Name or number of the place.
    pose
        `base` in the frame of the place.
    score
        Similarity, 0 to 1; comparable among the candidates of one recogniser.
    refusal
        Why this one does not count; "" if it may.
    """

    place: PlaceT
    pose: SE2
    score: float
    refusal: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Recognition(Generic[CandidateT]):
    """Result of comparing what is sensed with the known places.

    Parameters
    ----------
    candidates
        All that were similar enough to be looked at, best first.
    refusal
        Why no place is recognised, a sentence; "" if one is.
    """

    candidates: tuple[CandidateT, ...]
    refusal: str = ""

    @property
    def found(self) -> CandidateT | None:
        """The recognised place; None if it is refused."""
        if self.refusal:
            return None
        return next((each for each in self.candidates if not each.refusal), None)


class PlaceRecogniser(Protocol[SensedT_contra, CandidateT]):
    """Anything that remembers places and suggests which of them the robot is at."""

    def suggest(self, sensed: SensedT_contra) -> Recognition[CandidateT]:
        """Return the known places that what is sensed may be of."""
