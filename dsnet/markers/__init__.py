"""Real optical markers on skin: files, segments, poses, comparison."""
