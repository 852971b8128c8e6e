"""The composition root: from a configuration to objects and processes."""
