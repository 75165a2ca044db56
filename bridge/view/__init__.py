"""Seeing predictions in a browser, as they move: `dsnet view`, and recordings of it."""
