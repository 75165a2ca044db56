"""Steps of `tools/build_gallery.py`: who moves, which lap of a motion, and how it is drawn."""
