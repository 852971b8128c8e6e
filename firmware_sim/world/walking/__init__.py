"""How people walk: one file for each manner."""
