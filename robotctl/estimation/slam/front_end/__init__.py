"""Scan matching: where a scan was taken, seen from scans before."""
