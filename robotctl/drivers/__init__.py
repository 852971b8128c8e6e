"""The ports of the runtime on real wires: CAN bus, motor controllers, sensors, MAVLink links.

Public names:

- `can.port.SocketPort`, `can.robot_can.CanRobot`, `can.nodes.registry.CAN_NODES`: the CAN
  bus, and the nodes on it
- `can.dbc.load_dbc`, `can.nodes.robot_codec.RobotCodec`, `can.candump.CandumpReader`: frames by the
  DBC
- `mavlink.link.MavlinkLinks`, `lidar.rplidar.Rplidar`, `camera.video_capture.VideoFile`: MAVLink
  links, a lidar, cameras
"""
