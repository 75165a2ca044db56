"""What the better predictor knows of tissue: nodes on the skin, loads on them, their mechanics."""
