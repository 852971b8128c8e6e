"""Messages between the parts of robotctl: typed values without behaviour.

Public names:

- `control.ControlState`, `control.NavigationState`, `estimation.LocalisationState`: what a robot
  publishes
- `control.Arm`, `control.EmergencyStop`, `control.SetMode`, `control.VelocityTarget`: what one may
  ask of it
- `estimation.LidarScan`, `control.ExternalPose`: what other programs may send it
- `control.Feedback`, `actuators.ActuatorCommand`: what a tick of control reads and writes
- `faults.Fault`, `faults.FaultCode`: why a robot stops or does not arm
- `world_pose.WorldPose`: the pose in the world, by one policy
"""
