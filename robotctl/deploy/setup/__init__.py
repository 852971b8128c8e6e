"""Guided set-up of a new robot: steps of questions, answers and slow motions on blocks."""
