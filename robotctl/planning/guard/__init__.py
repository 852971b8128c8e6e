"""Obstacle avoidance."""
