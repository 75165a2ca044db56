"""Commands that call several packages."""
