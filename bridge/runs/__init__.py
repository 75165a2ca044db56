"""Runs: artifacts on disk, the chain from one to the next, and who makes them."""

from bridge.runs.artifact import Artifact, ArtifactWriter, read_artifact, write_artifact
from bridge.runs.run import Run

__all__ = ["Artifact", "ArtifactWriter", "Run", "read_artifact", "write_artifact"]
