"""The localisers, by the names that robots' files and `--localiser` give; light to read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias


class LocaliserKind(NamedTuple):
    """A localiser: where its code is, and which settings have a meaning for it."""

    module: str
    """Module whose `make` returns the localiser; imported only where a robot uses it."""
    needs_map: bool = False
    """Whether it finds the robot on `localisation.map`."""
    needs_walls: bool = False
    """Whether that map must have walls, so be a world."""
    searches_map: bool = False
    """Whether the robot may start anywhere on the map."""
    weighs_places: bool = False
    """Whether `localisation.places` helps it."""
    makes_map: bool = False
    """Whether it makes its own map, and keeps it in `localisation.keyframes`."""
    matches_images: bool = False
    """Whether it recognises places by images, for which the camera describes their features."""


LOCALISERS: Final[dict[str, LocaliserKind]] = {
    "mcl": LocaliserKind(
        "robotctl.app.localisation.mcl_localiser",
        needs_map=True,
        searches_map=True,
        weighs_places=True,
    ),
    "ekf": LocaliserKind(
        "robotctl.app.localisation.ekf_localiser", needs_map=True, needs_walls=True
    ),
    "slam": LocaliserKind(
        "robotctl.app.localisation.slam_localiser", makes_map=True, matches_images=True
    ),
}
"""Localisers by `localisation.method`: a new one is one file, and one line here."""

ODOMETRY_ONLY: Final = LocaliserKind("")
"""Robot without a localiser, `none`."""

if TYPE_CHECKING:
    LocaliserName: TypeAlias = str
else:
    LocaliserName = Literal[("none", *LOCALISERS)]


def localiser_kind(method: str) -> LocaliserKind:
    """Return the localiser of that name, `ODOMETRY_ONLY` for `none`."""
    return LOCALISERS.get(method, ODOMETRY_ONLY)


def names_with(ability: str) -> str:
    """Return the localisers with an ability, a field of `LocaliserKind`, as errors list them."""
    return " or ".join(f'"{name}"' for name, kind in LOCALISERS.items() if getattr(kind, ability))
