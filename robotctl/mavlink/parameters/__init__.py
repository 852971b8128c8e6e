"""Parameters: values of the robot's file that ground stations read and set."""
