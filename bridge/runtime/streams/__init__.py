"""Characters who move while one watches: frame by frame, at any frame rate, who come and go."""
