"""How stages grow with the corpus: smooth corpora that cost nothing, and children measured."""
