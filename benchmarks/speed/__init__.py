"""How fast training, prediction and posing are, beside their limits and their peers."""
