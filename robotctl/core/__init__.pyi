"""Public names of the package; importing one loads its module only."""

from .checkpoint import restored as restored
from .control_core import ControlCore as ControlCore
from .control_tick import ControlTick as ControlTick
from .navigation_tick import NavigationTick as NavigationTick
from .operator import Operator as Operator
