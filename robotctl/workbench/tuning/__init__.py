"""Tuning the wheel loops."""
