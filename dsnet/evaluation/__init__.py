"""Evaluation: errors of predictions by test group."""
