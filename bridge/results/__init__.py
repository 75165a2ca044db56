"""Metrics, evaluation, figures and the report."""
