"""Simulated runs, in real time and in lockstep, and their score."""
