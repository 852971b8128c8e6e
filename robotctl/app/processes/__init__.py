"""The processes of a robot: control, navigation, telemetry, camera, recorder."""
