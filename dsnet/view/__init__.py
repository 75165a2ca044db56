"""The page in which the model runs."""
