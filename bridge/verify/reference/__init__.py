"""The method once more in float64 NumPy, written to be read: every layer, its gradient, Adam."""
