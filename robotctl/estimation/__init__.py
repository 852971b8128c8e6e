"""On-board estimators."""
