"""Load the body that comes with the package, and change its shape by the first beta."""

import numpy as np

import dsnet

body = dsnet.load_body("embedded:female")  # or the path of a licensed SMPL .npz or .pkl
print(f"{body.name} ({body.source}): {body.vertex_count} vertices, {len(body.faces)} faces")

pose, trans = np.zeros((1, 24, 3)), np.zeros((1, 3))  # axis-angle, radians; metres
for first_beta in (-2.0, 0.0, 2.0):
    betas = np.zeros((1, 10))
    betas[0, 0] = first_beta
    [vertices_m] = dsnet.pose_vertices(body, betas, pose, trans)  # y is up
    width_m, height_m, depth_m = np.ptp(vertices_m, axis=0)
    print(f"beta 0 = {first_beta:4.1f}: {height_m:.2f} m high, {depth_m:.2f} m deep")
