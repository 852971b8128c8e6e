"""The simulated camera and robotctl agree, written apart; and one calibrates the other."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.camera.lens import pixel_rays
from firmware_sim.camera.truth import project
from firmware_sim.config import camera_parameters as simulated
from robotctl.config.patch import as_overrides
from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.sensors.camera import CameraConfig, CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.workbench.camera.calibrate import calibrate_camera
from robotctl.workbench.camera.options import CameraCalibrateOptions
from robotctl.workbench.camera.patch import patch_values

ROBOT = find_file("diff_drive")
LENS = CameraIntrinsics(64, 48, 45.0, 46.0, 31.0, 23.0, (-0.1, 0.03, 1e-3, -5e-4, 0.002))

mounts = st.builds(
    CameraMount,
    x_m=st.floats(-0.5, 0.5),
    y_m=st.floats(-0.5, 0.5),
    z_m=st.floats(0.05, 2.0),
    yaw_deg=st.floats(-180.0, 180.0),
    pitch_deg=st.floats(-20.0, 89.0),
    roll_deg=st.floats(-40.0, 40.0),
)


def twin(lens: CameraIntrinsics) -> simulated.Intrinsics:
    return simulated.Intrinsics(**asdict(lens))


def nominal() -> CameraConfig:
    camera = load_robot(ROBOT).camera
    assert camera is not None
    return camera


@settings(max_examples=50)
@given(mount=mounts)
def test_both_sides_see_a_point_at_one_pixel_and_a_pixel_in_one_direction(
    mount: CameraMount,
) -> None:
    camera = CameraGeometry(LENS, mount)
    other = simulated.CameraMount(**asdict(mount))
    rng = np.random.default_rng(1)
    ahead = np.column_stack([rng.uniform(-0.5, 0.5, (40, 2)), np.ones(40)])
    points = ahead * rng.uniform(0.3, 4.0, (40, 1)) @ camera.R_base_camera.T + camera.t_base_camera
    assert camera.project(points) == pytest.approx(project(points, twin(LENS), other), abs=1e-6)
    rays = pixel_rays(twin(LENS), other)
    u, v = np.meshgrid(np.arange(64.0), np.arange(48.0))
    ours = camera.rays_base(np.column_stack([u.ravel(), v.ravel()]))
    c, s = np.cos(np.radians(mount.yaw_deg)), np.sin(np.radians(mount.yaw_deg))
    level = ours[:, :2] @ np.array([[c, -s], [s, c]])
    length = np.hypot(*level.T)
    # Straight down no level direction is left to compare.
    clear = length > 1e-3
    assert (level / length[:, None])[clear, 0] == pytest.approx(rays.ahead.ravel()[clear], abs=1e-6)
    assert (level / length[:, None])[clear, 1] == pytest.approx(rays.left.ravel()[clear], abs=1e-6)
    assert (ours[:, 2] / length)[clear] == pytest.approx(rays.slope.ravel()[clear], rel=1e-5)


def test_a_simulated_camera_that_is_mounted_wrong_is_found_out_by_calibration(
    tmp_path: Path,
) -> None:
    config = nominal()
    wrong = simulated.CameraParameters(
        z_error_m=0.01, yaw_error_deg=-1.5, pitch_error_deg=2.0, roll_error_deg=1.0, x_error_m=-0.02
    )
    mount = wrong.true_mount(simulated.CameraMount(**asdict(config.mount)))
    rng = np.random.default_rng(2)
    ground = np.array([(x, side * 0.4 * x) for x in (0.5, 0.9, 1.5, 2.2, 3.0) for side in (-1, 1)])
    on_floor = np.column_stack([ground, np.zeros(len(ground))])
    pixels = project(on_floor, twin(config.intrinsics), mount)
    pixels += 0.3 * rng.normal(size=pixels.shape)
    file = tmp_path / "points.csv"
    rows = [f"{u:.2f},{v:.2f},{x},{y}" for (u, v), (x, y) in zip(pixels, ground, strict=True)]
    file.write_text("\n".join(["u,v,x,y", *rows]))
    result = calibrate_camera(
        CameraCalibrateOptions(ROBOT, points=file, sigma_px=0.3, sigma_mm=0.5),
        lambda _line: None,
    )
    assert result.fit is not None
    for key, sigma in result.fit.sigma.items():
        assert abs(getattr(result.fit.mount, key) - getattr(mount, key)) < 3.5 * sigma, key
    found = load_robot(ROBOT, as_overrides(patch_values(result))).camera
    assert found is not None
    probe = np.array([[1.0, 0.2, 0.0], [2.0, -0.5, 0.0]])
    seen = project(probe, twin(config.intrinsics), mount)
    before = CameraGeometry.of(config).ground(seen) - probe[:, :2]
    after = CameraGeometry.of(found).ground(seen) - probe[:, :2]
    assert np.abs(after).max() < 0.02
    assert np.abs(before).max() > 0.1
