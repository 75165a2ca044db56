"""What aligners give back of a motion whose truth is known."""
