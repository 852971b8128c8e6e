"""Parameters, files, logs and CAN frames."""
