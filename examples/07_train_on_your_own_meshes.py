"""Train the best predictor on registered meshes of your own (needs the extra `train`).

python examples/07_train_on_your_own_meshes.py SMPL_FEMALE.npz MESHES.h5 [MESHES.h5 ...]

The first file is the SMPL model whose topology the meshes have. The others hold the meshes in the
format of Dyna and D-FAUST, (V, 3, T) metres at 60 frames a second: docs/data.md. Results are
written to runs/mine; an interrupted command continues when it is run again.
"""

import subprocess
import sys

import dsnet


def stage(*command: str) -> None:
    """Run a stage as a process; if it fails, it has printed why."""
    if status := subprocess.call([sys.executable, "-m", "dsnet.cli", *command]):
        sys.exit(status)


smpl, *meshes = sys.argv[1:]
stage("align", "--run", "mine", "--aligner", "robust", "--smpl", smpl, "--dyna", *meshes)
stage("train", "--run", "mine", "--predictors", "dsnet_plus")

model = dsnet.load_model("mine")
dsnet.predict("sample:walking", "runs/mine_walking", model)
model.save("runs/mine_model")  # a folder for a colleague: dsnet.load_model("mine_model")
