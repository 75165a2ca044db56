"""Characters frame by frame."""
