"""Compilation ahead of time: every compiled function is called once, with whatever fits it."""
