"""Settings of the robust aligner."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.options import NonNegativeInt, PositiveInt


@dataclass(frozen=True)
class RobustSettings:
    """How much work the robust aligner does; `docs/alignment.md` shows what each buys."""

    vertices: PositiveInt = 800
    """About how many of the mesh's vertices the pose is read from."""
    steps: NonNegativeInt = 4
    """Gauss-Newton steps for each frame."""
    calibration_frames: PositiveInt = 192
    """Frames of each subject, spread over all of its motions, that tell how soft it is where."""
    calibration_rounds: NonNegativeInt = 12
    """Revisions of each subject's softness."""

    @classmethod
    def fast(cls) -> RobustSettings:
        """Half the work or less."""
        return cls(vertices=400, calibration_frames=96)
