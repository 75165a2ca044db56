"""Compare SMPL in Keras with SMPL in NumPy (needs the extra `train`).

python examples/08_verify.py

`dsnet verify --run RUN` compares every layer, gradient and training step in four engines.
"""

import numpy as np

import dsnet
from tf_dsnet import KerasSMPL, build_dsnet

print(f"DSNet in Keras: {build_dsnet().count_params():,} parameters")

body, rng = dsnet.load_body("embedded:female"), np.random.default_rng(0)
betas = rng.normal(size=(4, 10)).astype(np.float32)
pose = rng.normal(scale=0.3, size=(4, 24, 3)).astype(np.float32)  # axis-angle
trans = rng.normal(size=(4, 3)).astype(np.float32)  # metres

by_keras = np.asarray(KerasSMPL(body)(betas, pose, trans))  # (4, V, 3) metres, float32
by_numpy = dsnet.pose_vertices(body, *(a.astype(np.float64) for a in (betas, pose, trans)))

difference_mm = 1e3 * np.abs(by_keras - by_numpy).max()
print(f"vertices {by_keras.shape} differ by at most {difference_mm:.1e} mm")
