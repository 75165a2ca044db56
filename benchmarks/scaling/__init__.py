"""What more workers give, what they cost, and what a million sequences would take."""
