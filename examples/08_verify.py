"""Does Keras compute what the formulas say? DSNet beside its float64 reference in NumPy.

python examples/08_verify.py (needs the extra `train`)

`dsnet verify --run RUN` asks this of every layer, gradient and training step, in four engines.
"""

import numpy as np

from dsnet.verify.reference import dsnet
from tf_dsnet import build_dsnet
from tf_dsnet.model import named_weights

model = build_dsnet()
print(f"{model.count_params():,} parameters")

rng = np.random.default_rng(0)
inputs = rng.normal(size=(2, 30, 79)).astype(np.float32)  # 2 clips of 30 frames: betas and theta
by_keras = np.asarray(model(inputs))

weights = {name: array.astype(np.float64) for name, array in named_weights(model).items()}
by_formula = dsnet.predict(weights, inputs.astype(np.float64))["fc_enc_3"]

difference = np.abs(by_keras - by_formula).max() / np.abs(by_formula).max()
print(f"latents {by_keras.shape} differ by at most {difference:.1e} of the largest")
