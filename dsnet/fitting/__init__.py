"""Constants of flesh from markers on skin."""
