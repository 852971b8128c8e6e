"""The live view of a run: picture, keys and spoken lines."""
