"""Which bodies a folder's motions move: reported, and refused where nobody has asked for them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from bridge.body.embedded import EMBEDDED_PREFIX
from bridge.errors import DsnetError, notify
from bridge.motion.readers import is_smpl_family
from dsnet.prediction.load_model import Source, find_model
from dsnet.prediction.shape_space import UseOfBetas


def refuse_unnamed_body(
    source: Source, predictor: str | None, folder: Path, files: Iterable[Path]
) -> None:
    """Refuse SMPL's motions for an embedded body that nobody has asked for.

    It has as many vertices and faces as SMPL in another order, and cannot take their betas: what
    comes of it has the right shape and is of no use on SMPL. Files are looked at until one is
    SMPL's.
    """
    if not find_model(source, predictor).body_model.startswith(EMBEDDED_PREFIX):
        return
    if (smpls := next((path for path in files if is_smpl_family(path)), None)) is not None:
        raise DsnetError(
            f"--motion {folder} without --body, with motions of SMPL's bodies such as "
            f"{smpls.relative_to(folder)}",
            "--body BODY, a prepared licensed body: the SMPL, SMPL-H or SMPL-X file, or a folder "
            "of them",
            "Or pass --body embedded to move the embedded body knowingly: its vertices are in "
            "another order than SMPL's, and the motions' betas are not used.",
        )


def report_bodies(moved: Sequence[tuple[str, UseOfBetas]]) -> None:
    """A line: the bodies that motions move, and of how many the betas are not used."""
    if not moved:
        return
    names = " and ".join(sorted({name for name, _ in moved}))
    embedded = any(name.startswith(EMBEDDED_PREFIX) for name, _ in moved)
    order = " (vertices in another order than SMPL's)" * embedded
    unused = sum(of_betas == "not used" for _, of_betas in moved)
    notify(f"moves {names}{order}; of {unused} of {len(moved)} motions the betas are not used")
