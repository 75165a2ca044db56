"""A moving body as files that other tools open: one module a format, named in `formats`."""
