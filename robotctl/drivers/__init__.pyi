"""Public names of the package; importing one loads its module only."""

from .camera.video_capture import VideoFile as VideoFile
from .can.candump import CandumpReader as CandumpReader
from .can.dbc import load_dbc as load_dbc
from .can.nodes.registry import CAN_NODES as CAN_NODES
from .can.nodes.robot_codec import RobotCodec as RobotCodec
from .can.port import SocketPort as SocketPort
from .can.robot_can import CanRobot as CanRobot
from .lidar.rplidar import Rplidar as Rplidar
from .mavlink.link import MavlinkLinks as MavlinkLinks
