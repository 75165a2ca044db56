"""Runs: artifacts on disk, the chain from one to the next, and who makes them."""

from bridge.runs.artifact import Artifact, read_artifact
from bridge.runs.run import Run
from bridge.runs.writer import ArtifactWriter, write_artifact

__all__ = ["Artifact", "ArtifactWriter", "Run", "read_artifact", "write_artifact"]
