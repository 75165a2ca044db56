"""Run an exported predictor with NumPy and ONNX Runtime alone, on jumps of two bodies.

python examples/09_onnx_runtime_only.py MODEL.onnx
"""

import sys

import numpy as np
import onnxruntime

session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
about = session.get_modelmeta().custom_metadata_map
print(f"{about['predictor']} of run {about['run']!r}, {about['data']} data, {about['gender']}")

theta = np.zeros((2, 69), np.float32)  # two characters, 22 joints and a translation each
betas = np.array([np.zeros(10), np.linspace(-1, 1, 10)], np.float32)
state = np.zeros((2, session.get_inputs()[2].shape[1]), np.float32)  # zeros: both start
heights_m = np.concatenate([0.3 * np.abs(np.sin(np.arange(60) / 9)), np.zeros(60)])
first = np.zeros(0)
for frame, height_m in enumerate(heights_m):
    theta[:, 67] = height_m
    feed = {"theta": theta, "betas": betas, "state": state}
    # vertices are (2, V, 3) metres; pass the state to the next frame
    vertices, state = map(np.asarray, session.run(None, feed))
    first = first if first.size else vertices
    if frame % 20 == 19:
        range_mm = 1000 * np.ptp(vertices - first, axis=1)[:, 1]  # 0 for a rigid body
        print(f"frame {frame + 1:3d}: heights changed unequally, by {range_mm.round(1)} mm")
