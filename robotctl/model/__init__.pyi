"""Public names of the package; importing one loads its module only."""

from .drives.drives import AckermannDrive as AckermannDrive
from .drives.drives import DifferentialDrive as DifferentialDrive
from .drives.drives import MecanumDrive as MecanumDrive
from .drives.drives import TricycleDrive as TricycleDrive
from .drives.motion import arc as arc
from .drives.motion import integrate as integrate
from .geometry.pose_estimate import PoseEstimate as PoseEstimate
from .geometry.se2 import SE2 as SE2
from .geometry.se3 import SE3 as SE3
from .geometry.twist import Twist as Twist
from .grid_map import GridMap as GridMap
from .recording import Recording as Recording
from .sensors.range_scan import RangeScan as RangeScan
from .sensors.sonar import SonarMount as SonarMount
from .trajectory import Trajectory as Trajectory
from .wall_map import WallMap as WallMap
