"""Verification: every engine is compared with a float64 reference."""
