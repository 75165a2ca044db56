"""Turn the knobs: more belly, no arms, another body, feet on the floor.

The same as options of `dsnet predict`, `export` and `view`: --gain, --part-gain, --shape, --floor.
"""

import numpy as np

import dsnet

motion = dsnet.load_motion("sample:jumping_jacks")
asked = {
    "as predicted": dsnet.animate(motion),
    "gain=0.5": dsnet.animate(motion, gain=0.5),
    "more belly, no arms": dsnet.animate(motion, part_gain=["belly=2", "arms=0"]),
    "heavy, on the floor": dsnet.animate(motion, shape="heavy", floor="scale"),
}
for name, moving in asked.items():
    vertices_m, offsets_m = moving.arrays()  # (T, V, 3) each
    largest_mm = 1e3 * np.linalg.norm(offsets_m, axis=-1).max()
    lowest_cm = 100 * vertices_m[..., 1].min()
    print(f"{name}: up to {largest_mm:.0f} mm of offset, lowest point at {lowest_cm:.1f} cm")
