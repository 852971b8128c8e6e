"""`Drive`: all kinds of drives. Another one is a class like these, and a line here."""

from __future__ import annotations

from typing import Annotated, Final, TypeAlias, get_args, get_type_hints

from pydantic import Field

from firmware_sim.config.drives.differential import DifferentialDrive
from firmware_sim.config.drives.rollers import MecanumDrive, OmniDrive
from firmware_sim.config.drives.skid_steer import SkidSteerDrive
from firmware_sim.config.drives.steered import AckermannDrive, TricycleDrive

Drive: TypeAlias = Annotated[
    DifferentialDrive | TricycleDrive | AckermannDrive | SkidSteerDrive | MecanumDrive | OmniDrive,
    Field(discriminator="kind"),
]

KIND_NAMES: Final[tuple[str, ...]] = tuple(
    get_args(get_type_hints(kind)["kind"])[0] for kind in get_args(get_args(Drive)[0])
)
