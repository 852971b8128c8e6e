"""Score of a simulated run against the truth; nothing of it is loaded on a robot."""
