"""Kinds of drives: what `[drive]` may say, and how the wheels of each stand on the floor."""
