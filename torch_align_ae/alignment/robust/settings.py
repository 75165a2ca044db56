"""Settings of the robust aligner."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.options import NonNegativeInt, PositiveFloat, PositiveInt


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
    precision_m: PositiveFloat = 1e-4
    """Metres of unexplained motion at which a vertex counts half in the pose."""
    inertia: bool = True
    """Take out the displacement that a vertex's own acceleration explains, and the law's
    other terms with it. Without it vertices are only weighted by how little they jiggle."""
    gravity: bool = True
    """Gravity among the loads: the tissue of a limb that is turned hangs in another direction."""
    stiffening: bool = True
    """A term that lets small loads move the tissue more than their share."""
    coupling: bool = True
    """A term for the loads of the skin around each vertex."""
    damping: bool = True
    """A term that lets the displacement follow its load late."""
    noise: bool = True
    """Of noisy meshes, such as registrations of people, take what the law leaves unexplained of
    the firmest vertices for what it leaves of all, and not for softness."""
    shape_frames: PositiveInt = 1
    """Frames that give each subject's shape; the paper uses the first. More are spread over all
    of the subject's motions."""
    correct_shape: bool = True
    """Correct the shape by all calibration frames, once it is known how their tissue hangs."""
    shape_steps: NonNegativeInt = 8
    """Gauss-Newton steps for the shape."""

    @classmethod
    def fast(cls) -> RobustSettings:
        """Half the work or less."""
        return cls(vertices=400, calibration_frames=96)
