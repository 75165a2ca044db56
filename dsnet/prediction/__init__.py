"""From a motion to a moving body."""
