"""Typed, pure maths: poses, drive kinematics, motion and its noise."""
