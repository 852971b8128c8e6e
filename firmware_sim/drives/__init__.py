"""Twins of motor drives that people can buy: their documented behaviour on the simulated bus."""
