"""Write a dataset with soft tissue: the skin offsets of every motion below a folder.

python examples/10_write_a_dataset.py [FOLDER [OUT]]

Without a folder, two samples are used. An interrupted run continues when it is run again. The same
as a command:
dsnet predict --motion AMASS --out OUT --write offsets16
"""

import shutil
import sys
from importlib.resources import files
from pathlib import Path

import dsnet
from bridge import read_artifact

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "motions")
out = Path(sys.argv[2] if len(sys.argv) > 2 else "offsets")
if __name__ == "__main__":  # needed, as worker processes import this file
    if not folder.exists():
        for name in ("walk_cycle", "jumping_jacks"):
            (folder / name).mkdir(parents=True)
            sample = files("bridge.motion") / "samples" / f"{name}.npz"
            shutil.copy(str(sample), folder / name / f"{name}_poses.npz")
    dsnet.predict(folder, out, write=["offsets16"])
    for path in sorted(out.rglob("manifest.json")):
        artifact = read_artifact(path.parent)
        offsets_m = artifact.array("offsets")  # (T, V, 3) float16, in the rest pose, memory-mapped
        print(f"{path.parent.relative_to(out)}: {offsets_m.shape} of {artifact.manifest['source']}")
