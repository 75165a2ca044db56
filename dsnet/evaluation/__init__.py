"""Errors of predictions by test group."""
