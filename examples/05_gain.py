"""Control the dynamics: gains of body parts, another shape, feet on the floor.

`dsnet predict`, `export` and `view` have the options --gain, --part-gain, --shape and --floor.
"""

import numpy as np

import dsnet

motion = dsnet.load_motion("sample:jumping_jacks")
variants = {
    "as predicted": dsnet.animate(motion),
    "gain=0.5": dsnet.animate(motion, gain=0.5),
    "more belly, no arms": dsnet.animate(motion, part_gain=["belly=2", "arms=0"]),
    "heavy, on the floor": dsnet.animate(motion, shape="heavy", floor="scale"),
}
for name, moving in variants.items():
    vertices_m, offsets_m = moving.arrays()  # (T, V, 3) each
    largest_mm = 1e3 * np.linalg.norm(offsets_m, axis=-1).max()
    lowest_cm = 100 * vertices_m[..., 1].min()
    print(f"{name}: offsets of up to {largest_mm:.0f} mm, lowest point at {lowest_cm:.1f} cm")
