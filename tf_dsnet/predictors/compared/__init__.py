"""Predictors that are there to be compared with; see docs/architecture.md, "Predictors"."""
