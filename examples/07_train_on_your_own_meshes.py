"""Train the best predictor on registered meshes of your own (needs the extra `train`).

python examples/07_train_on_your_own_meshes.py SMPL_FEMALE.npz MESHES.h5 [MESHES.h5 ...]

The first file is the SMPL model whose faces the meshes share, the others hold them as Dyna's and
D-FAUST's files do, (V, 3, T) metres at 60 frames a second: docs/data.md. What the commands make
lies in runs/mine; stopped ones go on where they were.
"""

import subprocess
import sys

import dsnet


def stage(*command: str) -> None:
    """A stage of training, which is a process of its own; one that fails has said why."""
    if status := subprocess.call([sys.executable, "-m", "dsnet.cli", *command]):
        sys.exit(status)


smpl, *meshes = sys.argv[1:]
stage("align", "--run", "mine", "--aligner", "robust", "--smpl", smpl, "--dyna", *meshes)
stage("train", "--run", "mine", "--predictors", "dsnet_plus")

model = dsnet.load_model("mine")
dsnet.predict("sample:walking", "runs/mine_walking", model)
model.save("runs/mine_model")  # a folder for a colleague: dsnet.load_model("mine_model")
