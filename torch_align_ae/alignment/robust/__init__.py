"""The robust aligner: poses read from what does not jiggle, and from what the jiggling obeys.

Not the paper's method: it mends the limit that the paper admits in Section 6.
"""

from torch_align_ae.alignment.robust.align import align_sequences
from torch_align_ae.alignment.robust.settings import RobustSettings

__all__ = ["RobustSettings", "align_sequences"]
