"""What sonars and the lidar measure in a world."""
