"""Public names of the package; importing one loads its module only."""

from .actuators import ActuatorCommand as ActuatorCommand
from .control import Arm as Arm
from .control import ControlState as ControlState
from .control import EmergencyStop as EmergencyStop
from .control import ExternalPose as ExternalPose
from .control import Feedback as Feedback
from .control import NavigationState as NavigationState
from .control import SetMode as SetMode
from .control import VelocityTarget as VelocityTarget
from .estimation import LidarScan as LidarScan
from .estimation import LocalisationState as LocalisationState
from .faults import Fault as Fault
from .faults import FaultCode as FaultCode
from .world_pose import WorldPose as WorldPose
