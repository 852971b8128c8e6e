"""What the robot does: missions' items, wall following, return home, finding itself again."""
