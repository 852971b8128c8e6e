"""Drives of CiA 402 over CANopen, in velocity and profile-velocity mode; their makers as data."""
