"""What the stages exchange: artifacts, runs, poses, sequences, motions, weights."""

from bridge.exchange.artifact import Artifact, ArtifactWriter, read_artifact, write_artifact
from bridge.exchange.motion import Motion, load_amass_motion
from bridge.exchange.poses import (
    INPUT_SIZE,
    N_BETAS,
    N_JOINTS,
    THETA_SIZE,
    pack_theta,
    unpack_theta,
)
from bridge.exchange.run import Run
from bridge.exchange.sequences import Sequence, sequences_of, subject_rows, subjects_of, to_manifest
from bridge.exchange.weights import load_weights, save_weights

__all__ = [
    "INPUT_SIZE",
    "N_BETAS",
    "N_JOINTS",
    "THETA_SIZE",
    "Artifact",
    "ArtifactWriter",
    "Motion",
    "Run",
    "Sequence",
    "load_amass_motion",
    "load_weights",
    "pack_theta",
    "read_artifact",
    "save_weights",
    "sequences_of",
    "subject_rows",
    "subjects_of",
    "to_manifest",
    "unpack_theta",
    "write_artifact",
]
