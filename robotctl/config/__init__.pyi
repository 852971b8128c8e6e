"""Public names of the package; importing one loads its module only."""

from .robot_file import RobotConfig as RobotConfig
from .robot_file import find_file as find_file
from .robot_file import load_robot as load_robot
