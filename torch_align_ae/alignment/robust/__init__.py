"""The robust aligner: poses from the vertices that soft tissue moves least, less their inertia.

Not the paper's method: it mends the limit that the paper admits in Section 6, that fitted poses
absorb part of the dynamics. `tissue` says how.
"""

from torch_align_ae.alignment.robust.align import align_sequences
from torch_align_ae.alignment.robust.settings import RobustSettings

__all__ = ["RobustSettings", "align_sequences"]
