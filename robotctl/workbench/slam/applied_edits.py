"""Edits of a map, one after the other."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink
from robotctl.model.geometry.se2 import SE2
from robotctl.words import counted
from robotctl.workbench.slam.edited_map import EditedMap
from robotctl.workbench.slam.edits import Loop, MapEdits, Move, Refuse
from robotctl.workbench.slam.relations import RelationError, related

REACH: Final = 6
"""Difference in number up to which links of loops are of the same two visits."""
_CONTRADICTED: Final = 16.3
"""Squared residual of a pose that is right, exceeded once in 1000 (chi2, 3 degrees of freedom)."""


class EditError(RobotctlError):
    """An edit cannot be made, or there is no map to edit."""


class AppliedEdits:
    """Edits on their way into a map, numbered as in their file.

    Parameters
    ----------
    edited
        The map.
    file
        The file, for messages.
    begins
        Number of the first keyframe of each joined map.

    Attributes
    ----------
    refused
        Keyframes of the map, in pairs, whose links are refused.
    outcomes
        What became of each edit.
    """

    def __init__(self, edited: EditedMap, file: Path, begins: dict[str, int]) -> None:
        self._edited = edited
        self._file = file
        self._begins = begins
        self._given: list[tuple[str, range]] = []
        self.refused: list[tuple[int, int]] = []
        self.outcomes: list[dict[str, Any]] = []
        self._number()

    def _number(self) -> None:
        """Note the numbers of all keyframes in the file."""
        begins = np.array([0, *self._begins.values()])
        of, number = self._edited.origins.T
        self._numbers = begins[of] + number
        self._rows = {said: row for row, said in enumerate(self._numbers.tolist())}

    def said(self, row: int) -> int:
        """Return the number in the file of a keyframe."""
        return int(self._numbers[row])

    def apply(self, edits: MapEdits) -> None:
        """Apply all of them.

        Raises
        ------
        EditError
            If one cannot be made, or the map is in parts afterwards.
        """
        edited = self._edited
        dropped = {each for drop in edits.drop for each in range(drop.first, drop.last + 1)}
        edited.drop(dropped)
        self._number()
        for row, drop in enumerate(edits.drop):
            self._note("drop", row, keyframes=drop.last - drop.first + 1)
        for row, refuse in enumerate(edits.refuse):
            self._refuse(row, refuse)
        for row, cut in enumerate(edits.cut):
            links = edited.cut(self._rows[cut.before])
            self._note("cut", row, before=cut.before, links=links)
        if edits.drop or edits.refuse or edits.cut:
            edited.solve()
        for row, join in enumerate(edits.join):
            self._relate("join", row, join, join.other + self._begins[join.map])
        for row in sorted(range(len(edits.move)), key=lambda each: edits.move[each].keyframe):
            self._move(row, edits.move[row])
        for row, loop in enumerate(edits.loop):
            self._relate("loop", row, loop, loop.other)
        self._check_whole()

    def _note(self, kind: str, row: int, **figures: Any) -> None:
        """Keep what became of an edit."""
        self.outcomes.append({"edit": f"{kind}[{row}]", **figures})

    def _refuse(self, row: int, refuse: Refuse) -> None:
        """Leave out a loop."""
        ends = self._rows[refuse.keyframe], self._rows[refuse.other]
        found = self._edited.refuse(*ends, REACH)
        if not found:
            nearest = self._edited.loop_nearest(*ends)
            near = "the map has no loop"
            if nearest is not None:
                near = "the nearest is of {} and {}".format(*map(self.said, nearest))
            raise EditError(
                f"{self._file}: refuse[{row}]: no loop links keyframes {refuse.keyframe} and "
                f"{refuse.other}, or others within {REACH} of them; {near}"
            )
        self.refused += found
        self._note(
            "refuse", row, keyframe=refuse.keyframe, other=refuse.other, links=len(found)
        )  # fmt: skip

    def _relate(self, kind: str, row: int, edit: Loop, other: int) -> None:
        """Add a relation of two keyframes."""
        edited = self._edited
        ends = self._rows[edit.keyframe], self._rows[other]
        try:
            found = related(edited.growing, edited.drives, edit, *ends)
        except RelationError as error:
            raise EditError(
                f"{self._file}: {kind}[{row}]: keyframes {edit.keyframe} and {edit.other}: {error}"
            ) from error
        off = edit.pose.inverse() @ found.pose
        self._add(f"{kind}[{row}]", found.links, *ends, found.pose)
        self._note(
            kind, row, keyframe=edit.keyframe, other=edit.other,
            x_m=found.pose.x_m, y_m=found.pose.y_m,
            heading_deg=math.degrees(found.pose.theta_rad),
            off_m=math.hypot(off.x_m, off.y_m),
            score=None if edit.exact else found.score,
            overlap=found.overlap, contradiction=found.contradiction, links=len(found.links),
        )  # fmt: skip

    def _move(self, row: int, move: Move) -> None:
        """Give a keyframe a pose; the first keeps its own without a doubt."""
        edited, number = self._edited, self._rows[move.keyframe]
        before = edited.back_end.pose(number)
        if number == 0:
            edited.place_at(move.pose)
        else:
            sigmas = np.array([move.sigma_m, move.sigma_m, math.radians(move.sigma_deg)])
            pose = edited.back_end.pose(0).inverse() @ move.pose
            link = KeyframeLink(
                0, number, pose, np.diag(1.0 / sigmas**2), is_loop=True, is_given=True
            )
            self._add(f"move[{row}]", [link], 0, number, pose)
        off = before.inverse() @ move.pose
        self._note("move", row, keyframe=move.keyframe, off_m=math.hypot(off.x_m, off.y_m))

    def _add(
        self, name: str, links: list[KeyframeLink], first: int, second: int, pose: SE2
    ) -> None:
        """Add the links of an edit, and note which they are."""
        begin = len(self._edited.back_end.links)
        self._edited.add(links, first, second, pose)
        self._given.append((name, range(begin, begin + len(links))))

    def contradicted(self) -> list[str]:
        """Return reasons to doubt the map: edits that did not come true, since scans hold it."""
        back_end, reasons = self._edited.back_end, []
        for name, rows in self._given:
            link = back_end.links[rows[0]]
            off = link.pose.inverse() @ back_end.between(link.first, link.second)
            if back_end.squares(np.array(rows)).max() > _CONTRADICTED:
                reasons.append(
                    f"scans contradict {name}: they hold keyframe {self.said(link.second)} "
                    f"{math.hypot(off.x_m, off.y_m):.2f} m and "
                    f"{abs(math.degrees(off.theta_rad)):.1f} deg from there"
                )
        return reasons

    def _check_whole(self) -> None:
        """Refuse a map that is in parts."""
        parts = self._edited.parts()
        rows = np.flatnonzero(parts != parts[0])
        if len(rows):
            first, last = self.said(rows[0]), self.said(rows[-1])
            raise EditError(
                f"{self._file}: {counted(len(rows), 'keyframe')} from {first} to {last} are "
                "linked to nothing any more, and one map is needed: hold them by a [[loop]] or a "
                "[[move]], or leave them out by a [[drop]]"
            )
