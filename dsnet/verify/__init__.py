"""The float64 reference, and the comparison of the engines."""
