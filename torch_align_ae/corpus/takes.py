"""Everything that a corpus shows: what is trained on, and what is only predicted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.errors import DsnetError
from torch_align_ae.corpus.dyna_files import FPS
from torch_align_ae.corpus.real_motions import find_real_motions, real_takes
from torch_align_ae.corpus.sequences import Take, by_subject, dyna_takes, held_out_takes

if TYPE_CHECKING:
    from torch_align_ae.corpus.stage_corpus import CorpusConfig


@dataclass(frozen=True)
class Takes:
    """Everything that a corpus shows."""

    dyna: list[Take]
    """What is trained on, and validated."""
    held_out: list[Take]
    """What is only predicted: procedural and real motions."""
    files: list[Path]
    """Where the real ones are from."""

    @property
    def all(self) -> list[Take]:
        """Both, in the order in which they are stored."""
        return [*self.dyna, *self.held_out]

    @classmethod
    def of(cls, config: CorpusConfig) -> Takes:
        """The takes that a configuration asks for; nothing is made yet."""
        if min(config.mean_frames, config.mosh_seconds * FPS) < 60:
            raise DsnetError(
                f"mean_frames={config.mean_frames}, mosh_seconds={config.mosh_seconds:g}",
                "at least 60 frames and 1 second",
                "Longer sequences, fewer motions or subjects.",
            )
        gender, subjects, motions = config.gender, config.subjects, config.motions
        dyna = dyna_takes(gender, subjects, motions, config.mean_frames, config.seed)
        held_out = held_out_takes(
            gender,
            subjects,
            unseen=config.mosh_motions,
            known=motions[max(0, len(motions) - config.retakes) :],
            seconds=config.mosh_seconds,
            crossing=config.crossing,
        )
        files = find_real_motions(config.amass)
        held_out += real_takes(
            files,
            gender,
            subjects,
            config.amass_seconds,
            config.amass_fps,
            config.amass_smooth_hz,
        )
        return cls(dyna, by_subject(held_out, gender), files)
