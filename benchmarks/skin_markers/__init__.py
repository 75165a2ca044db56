"""What fits of flesh to skin markers find of a truth that is known."""
