"""Pure control laws: from a set-point and a measurement to a demand, without clock or I/O.

Public names:

- `pid.Pid`, `pid.PidConfig`, `pwm.PwmMap`, `wheel_velocity.WheelVelocityEstimator`: the loop of a
  wheel: PID with feed-forward, duty, speed from counts
- `limiter.TwistLimiter`, `limiter.LimitsConfig`: velocities within the limits of the robot
- `wall_following.WallFollower`, `servoing.servo`, `steering_law.steer_round`: laws of motion
- `identification.identification.fit_first_order`, `identification.tuning.simc_pi`: models and gains
  from experiments
"""
