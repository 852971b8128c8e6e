"""Where the robot is and what surrounds it, pure.

Public names:

- `odometry.odometry.Odometry`: pose from wheels
- `kalman.ekf.PoseEkf`, `landmarks.ekf.LandmarkEkf`: Kalman filters
- `mcl.localiser.MonteCarloLocaliser`, `ranging.likelihood_field.LikelihoodField`,
  `ranging.sonar_model.SonarModel`: Monte Carlo localisation, and its sensor models
- `grid.occupancy_grid.OccupancyGrid`: mapping
- `camera.calibration.homography.fit_homography`, `camera.calibration.intrinsics.calibrate_lens`,
  `camera.ground.GroundCamera`: cameras: lens, floor, obstacles on it
- `places.database.PlaceBook`: places known by sonar
"""
