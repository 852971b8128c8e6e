"""EKF-SLAM: one Gaussian of the robot and all features."""
