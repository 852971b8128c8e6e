"""Public names of the package; importing one loads its module only."""

from .behave.behaviours.registry import BEHAVIOURS as BEHAVIOURS
from .behave.mission.mission_file import parse_mission as parse_mission
from .guard.obstacle_guard import ObstacleGuard as ObstacleGuard
from .map.planning_map import PlanningMap as PlanningMap
from .navigator import Navigator as Navigator
from .path.global_planning.planners import PLANNERS as PLANNERS
from .path.local.pursuit import Pursuit as Pursuit
