"""Angles, poses and twists in the plane and in space."""
