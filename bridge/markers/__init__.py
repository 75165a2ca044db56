"""Predictions beside real optical markers on skin."""
