"""Exporting and plotting logs."""
