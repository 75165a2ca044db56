"""What each departure from the paper's words buys, one at a time."""
