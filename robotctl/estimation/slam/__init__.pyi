"""Public names of the package; importing one loads its module only."""

from .factors.between import BETWEEN_2D as BETWEEN_2D
from .graph.builder import GraphBuilder as GraphBuilder
from .graph.factor import FactorKind as FactorKind
from .graph.factor_graph import FactorGraph as FactorGraph
from .graph.variables import POINT2 as POINT2
from .graph.variables import SE2 as SE2
from .graph.variables import VariableKind as VariableKind
from .incremental.smoother import IncrementalSmoother as IncrementalSmoother
from .keyframes.mapper import SlamMapper as SlamMapper
from .robust.kernels import KERNELS as KERNELS
from .solvers.problem import Problem as Problem
from .solvers.problem import gauge as gauge
from .solvers.registry import SOLVERS as SOLVERS
from .start.registry import start_values as start_values
