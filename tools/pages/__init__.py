"""What `tools/update_pages.py` writes: each module's functions give the text of a block or page."""
