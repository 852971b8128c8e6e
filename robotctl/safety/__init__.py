"""Reasons to stop: state machine, health, plausibility and arming, pure."""
