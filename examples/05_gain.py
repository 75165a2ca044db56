"""Turn the knobs: more belly, no arms, another body, feet on the floor.

The same as options of `dsnet predict`, `export` and `view`: --gain, --part-gain, --shape, --floor.
"""

import numpy as np

from bridge import load_motion
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import load_model

motion = load_motion("sample:jumping_jacks")
trained = load_model(run=None, gender=motion.gender)
for controls in (
    Controls(),
    Controls(gain=0.5),
    Controls(part_gain=("belly=2", "arms=0")),
    Controls(shape=("heavy",), floor="scale"),
):
    moving = controlled_body(trained, motion, controls)
    largest_mm = max(1e3 * np.linalg.norm(p.offsets_m, axis=-1).max() for p in moving)
    lowest_cm = min(100 * posed.vertices_m[..., 1].min() for posed in moving)
    asked = controls.given() or "as predicted"
    print(f"{asked}: up to {largest_mm:.0f} mm of offset, lowest point at {lowest_cm:.1f} cm")
