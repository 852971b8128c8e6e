"""Public names of the package; importing one loads its module only."""

from .command_guard import guarded as guarded
from .health import Health as Health
from .state_machine import TRANSITIONS as TRANSITIONS
from .state_machine import SafetyConfig as SafetyConfig
from .state_machine import SafetyMachine as SafetyMachine
from .supervision import MONITORS as MONITORS
from .supervision import Supervision as Supervision
