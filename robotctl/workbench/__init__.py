"""Offline work behind the commands."""
