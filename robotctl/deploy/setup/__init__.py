"""The guided first day of a robot: steps of questions, answers and slow motions on blocks."""
