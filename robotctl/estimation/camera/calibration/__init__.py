"""Lens, mount and homography of a camera from known points."""
