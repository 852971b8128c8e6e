"""The parameters of a range sensor from its recordings."""
