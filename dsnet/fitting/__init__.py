"""Fit soft-tissue constants to skin markers."""
