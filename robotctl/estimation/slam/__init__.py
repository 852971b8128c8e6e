"""Simultaneous localisation and mapping: one joint estimate of robot and map."""
