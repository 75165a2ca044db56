"""What the training of `dsnet_plus` minimises, in numbers: see `tf_dsnet.oscillators`."""

QUIET_M = 2e-4
"""Root mean square offset below which a smaller one does not increase a clip's weight."""
QUIET_SHARE = 0.3
"""Weight of the term of the loss in which clips with small offsets count as much as others."""
NODE_PRIOR = {
    "omega": 1e-4, "damping_ratio": 1e-2, "stiffening": 3e-3, "sag": 3e-3, "normal_ratio": 3e-3,
    "wave_speed": 1e-2, "bending": 1e-2, "inertia_gain": 3e-2, "gravity_gain": 3e-2,
}  # fmt: skip
"""Strength of the prior that nodes have equal coefficients."""
GAIN_PRIOR, PEOPLE_PRIOR = 3e-2, 3e-3
"""Strength of the priors that gains are 1 and that people differ by their shape alone."""
