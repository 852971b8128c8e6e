"""The simulated camera: the scene, the lens, the light and what a picture shows."""
