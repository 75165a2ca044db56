"""Train the best predictor on registered meshes of your own (needs the extra `train`).

python examples/07_train_on_your_own_meshes.py SMPL_FEMALE.npz MESHES.h5 [MESHES.h5 ...]

The first file is the SMPL model whose faces the meshes share, the others hold them as Dyna's and
D-FAUST's files do, (V, 3, T) metres at 60 frames a second: docs/data.md. What the commands make
lies in runs/mine; stopped ones go on where they were.
"""

import sys

from bridge.processes import exit_with_one_line, outcome_of_module
from bridge.runs import Run
from dsnet.prediction.prediction_files import predict_motion


def dsnet(*command: str) -> None:
    """A stage, which is a process of its own; one that fails has said why."""
    if status := outcome_of_module("dsnet.cli", *command, quiet=False)[0]:
        sys.exit(status)


def main(smpl: str, *meshes: str) -> None:
    """Meshes to offsets, offsets to a predictor, a motion to a moving body."""
    dsnet("align", "--run", "mine", "--aligner", "robust", "--smpl", smpl, "--dyna", *meshes)
    dsnet("train", "--run", "mine", "--predictors", "dsnet_plus")
    predict_motion(Run("mine"), "sample:walking", "runs/mine_walking")


with exit_with_one_line():
    main(*sys.argv[1:])
