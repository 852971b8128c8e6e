"""Plans on maps, without a robot."""
