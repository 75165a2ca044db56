"""Every operation in NumPy, as plainly as it can be said."""
