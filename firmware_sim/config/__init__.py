"""The simulator's reading of a robot's file, independent of robotctl's."""
