"""The web page's server: what a browser sees of the robot, and may ask of it."""
