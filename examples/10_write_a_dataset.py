"""Write a dataset with soft tissue: the skin offsets of every motion below a folder.

python examples/10_write_a_dataset.py [FOLDER [OUT [BODY]]]

Without a folder, two samples are used. BODY is your SMPL file or a folder of them; without, the
embedded bodies move, whose vertices are in another order than SMPL's. An interrupted run continues
when it is run again. The same as a command:
dsnet predict --motion AMASS --out OUT --body BODY --write nodes16
"""

import shutil
import sys
from importlib.resources import files
from pathlib import Path

import dsnet

given = dict(enumerate(sys.argv))
folder, out = Path(given.get(1, "motions")), Path(given.get(2, "offsets"))
if __name__ == "__main__":  # needed, as worker processes import this file
    if not folder.exists():
        for name in ("walk_cycle", "jumping_jacks"):
            (folder / name).mkdir(parents=True)
            sample = files("bridge.motion") / "samples" / f"{name}.npz"
            shutil.copy(str(sample), folder / name / f"{name}_poses.npz")
    dsnet.predict(folder, out, write=["nodes16"], body=given.get(3, "embedded"))
    for clip in dsnet.load_flesh(out):  # a data set for torch.utils.data.DataLoader, too
        some_m = clip.offsets_m[:32]  # (T, V, 3) in the rest pose, metres: these frames alone
        print(f"{clip.name}: {clip.offsets_m.shape} by theta {clip.theta.shape}, {some_m.dtype}")
