"""The localisers of the navigation process: sensors in, poses in the world out."""
