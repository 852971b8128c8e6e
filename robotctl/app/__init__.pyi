"""Public names of the package; importing one loads its module only."""

from .processes.robot import make_core as make_core
from .processes.robot import make_robot as make_robot
from .simulation.lockstep import LockstepRun as LockstepRun
from .simulation.lockstep import run_lockstep as run_lockstep
from .simulation.sim_options import SimOptions as SimOptions
