"""How well unseen motions are predicted: the test bed, and what made the difference."""
