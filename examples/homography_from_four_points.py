"""Four marks on the floor, seen by a camera, tell where all lies that it sees, and how surely.

python examples/homography_from_four_points.py
"""

import numpy as np

from robotctl.estimation.camera.calibration.homography import PointNoise, fit_homography

# x forward, y left [m]; u right, v down [px].
marks_m = np.array([[0.5, 0.3], [0.5, -0.3], [2.0, 0.5], [2.0, -0.5]])
seen_px = np.array([[160.0, 420.0], [480.0, 420.0], [228.0, 140.0], [412.0, 140.0]])

homography = fit_homography(marks_m, seen_px, PointNoise(sigma_px=0.5))
pixels = np.array([[320.0, 300.0], [320.0, 150.0]])
places, spreads = homography.ground_covariance(pixels, sigma_px=0.5)
for (u, v), (x, y), spread in zip(pixels, places, spreads, strict=True):
    sigma_x, sigma_y = 1000.0 * np.sqrt(np.diag(spread))
    print(f"{u:.0f}, {v:.0f}: x {x:.3f} m, y {y:+.3f} m, within {sigma_x:.0f} and {sigma_y:.0f} mm")
