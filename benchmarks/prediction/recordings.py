"""`python -m benchmarks.prediction.recordings --out FILE.md --folders DIR ...`: recorded motions.

Each folder is one of `benchmarks.prediction.test_bed` with real motions; over those of a corpus the
table has the median of what each clip scores, for known people and for new ones. Below it stands
what lies beside the page: errors by frequency (bands_*.json) and the law read twice
(readings.json).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.prediction import bands, readings
from benchmarks.prediction.corpora import read_index
from benchmarks.prediction.over_seeds import is_real
from benchmarks.processes import run_as_process
from bridge.errors import DsnetError
from bridge.runs.files import write_text_atomically

GOAL_R2 = 0.85
_PEOPLE = ("known person", "new person")
_HEAD = ("motions", "corpus", "who", "clips", "true offsets [mm]", "R²", "least R²", "its clip",
         f"clips of {GOAL_R2} and more", "velocity R²")  # fmt: skip
_PAGE = """\
# Recorded motions under simulated tissue (synthetic data but for the motions)

{table}

`dsnet_plus`, trained on the robust aligner's offsets of each corpus as in the test bed, on recorded
motions that synthetic people follow with simulated tissue: medians over clips, one for each motion
and person (and seed), of the offsets' root mean square, of R² and of their velocity's R².
Scores of every clip and the command that made them lie in the folder of that name.
Made by `{command}`.
"""


@dataclass(frozen=True)
class RecordingsConfig:
    """Write the page."""

    out: Path
    """The page, a .md."""
    folders: tuple[Path, ...]
    """Of the test bed."""


def main(config: RecordingsConfig) -> None:
    """Write it.

    Raises
    ------
    DsnetError
        If a folder has no real motions.
    """
    command = " ".join(["python", "-m", "benchmarks.prediction.recordings", *sys.argv[1:]])
    write_text_atomically(config.out, markdown(config.out, config.folders, command))


def markdown(out: Path, folders: Sequence[Path], command: str) -> str:
    """The page that lies at `out`, of these folders."""
    rows = [row for folder in folders for row in _rows(folder)]
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" * 3 + "|---:" * (len(_HEAD) - 3) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return _PAGE.format(table="\n".join(lines), command=command) + "".join(_beside(out))


def _beside(out: Path) -> Iterator[str]:
    """Sections of other results that lie where the page does."""
    for path in sorted(out.parent.glob("bands_*.json")):
        law = path.stem.partition("_")[2]
        yield f"\n## Errors by frequency, law `{law}`\n\n{bands.markdown(path)}"
    if (path := out.with_name("readings.json")).is_file():
        yield f"\n## The second law, accelerations read twice\n\n{readings.markdown(path)}"


def _rows(folder: Path) -> Iterator[list[str]]:
    scores, _ = read_index(folder / "test_bed.json")
    for corpus in dict.fromkeys(score["corpus"] for score in scores):
        clips = [
            clip
            for score in scores
            if score["corpus"] == corpus
            for clip in filter(is_real, score["sequences"])
        ]
        if not clips:
            raise DsnetError(
                f"{folder}, of whose motions none is real",
                "a folder of the test bed with --amass",
                "Run benchmarks.prediction.test_bed --amass FOLDER.",
            )
        for who in _PEOPLE:
            own = [clip for clip in clips if clip["cell"].startswith(who.replace(" ", "_"))]
            yield [folder.name, corpus, who, *_summed_up(own)]


def _summed_up(clips: Sequence[Mapping[str, Any]]) -> list[str]:
    def of(predictor: str, what: str, figure: str) -> list[float]:
        return [clip["errors"][predictor][what][figure] for clip in clips]

    r2 = of("dsnet_plus", "offsets", "r2")
    least = clips[r2.index(min(r2))]["name"]
    return [
        str(len(clips)),
        # SMPL alone has no offsets: its error is what there is to predict.
        f"{median(of('smpl', 'offsets', 'rms_mm')):.2f}",
        f"{median(r2):.3f}",
        f"{min(r2):.3f}",
        f"`{least}`",
        str(sum(one >= GOAL_R2 for one in r2)),
        f"{median(of('dsnet_plus', 'velocity', 'r2')):.3f}",
    ]


if __name__ == "__main__":
    run_as_process(RecordingsConfig, main)
