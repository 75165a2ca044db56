"""How stages grow with the corpus and with workers, and what a million sequences would take."""
