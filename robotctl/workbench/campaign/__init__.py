"""Many simulated runs: what varies between them, how they run, and what they show."""
