"""Predictions and predictors in the formats of other tools."""
