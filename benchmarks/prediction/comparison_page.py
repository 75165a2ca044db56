"""The page of the comparison, made of its scores alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import mean
from typing import Any

from benchmarks.prediction.over_seeds import r2_of, summary, without_real
from bridge.motion.splits import CELLS

NOTHING = ("person_mean", "smpl")
"""What learns nothing of motions."""
BEST = "dsnet_plus"
_PAGE = """\
# Every system side by side (synthetic data)

{sections}

R² of the offsets against the simulated truth: 1 is exact, 0 is SMPL alone, below 0 is worse than
SMPL alone. Mean over {seeds}; ± is the standard deviation over seeds where there are several. All
were given the robust aligner's offsets of the same training clips. Systems of others are named
"-like": what their sources leave open is decided here, a clause each below. Those that feed back
their own predictions do so here too, from rest.
{made}

{figures}

## What each of them is

{systems}
"""
FIGURES = {
    "cells.png": "Error in each cell, known and new people",
    "cost.png": "Parameters against error",
    "over_time.png": "Size of the offsets over time under every system",
    "clips.png": "A motion that is new to all: the truth, and several systems",
}
"""clips.png is shown where it lies; commit `b9aa1159` has what drew it."""


def page(
    scores: Sequence[Mapping[str, Any]],
    commands: Sequence[str],
    folder: str,
    figures: Iterable[str],
) -> str:
    """The whole page, which lies beside its folder.

    Parameters
    ----------
    commands : the one that made the scores, and those that added rivals.
    """
    corpora = dict.fromkeys(score["corpus"] for score in scores)
    of = {corpus: [s for s in scores if s["corpus"] == corpus] for corpus in corpora}
    seeds = sorted({score["seed"] for score in scores})
    return _PAGE.format(
        sections="\n\n".join(_section(corpus, own) for corpus, own in of.items()),
        seeds=f"training seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))}",
        made=_made_by(*commands),
        figures="\n".join(f"![{FIGURES[name]}]({folder}/{name})" for name in figures),
        systems="\n".join(_described(scores[0])),
    )


def _made_by(command: str, *of_rivals: str) -> str:
    lines = [f"Made by `{command}`."]
    if of_rivals:
        lines.append(
            "Open rivals run as they are and are not trained, so that no seed changes them;"
        )
        lines.append("their settings are chosen on the validation clip:")
        lines.append(", ".join(f"`{one}`" for one in of_rivals) + ".")
    return "\n".join(lines)


def systems_of(scores: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of what every seed has, best first: by the mean R² over the cells."""
    having = set.intersection(*(set(_cells(score)) for score in scores))
    return sorted(having, key=lambda name: -mean(_means(scores, name)))


def _cells(score: Mapping[str, Any]) -> list[str]:
    shown = (BEST, *score["systems"], *NOTHING)
    return [name for name in shown if all(name in score["cells"][cell] for cell in CELLS)]


def _means(scores: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [mean(s["cells"][cell][name]["r2"] for s in scores) for cell in CELLS]


def _section(corpus: str, scores: Sequence[Mapping[str, Any]]) -> str:
    bed = scores[0]["test_bed"]
    law = f"Tissue law `{bed['tissue']}`, {bed['form']} meshes, {bed['gender']} bodies."
    return f"## Corpus `{corpus}`\n\n{law} {verdict(scores)}\n\n{_table(scores)}"


def _table(scores: Sequence[Mapping[str, Any]]) -> str:
    metrics = [f"{label}: {what}" for label in CELLS.values() for what in ("R²", "mesh mm")]
    without = [f"{label}, without real: R²" for label in list(CELLS.values()) if "unseen" in label]
    head = ["system", "parameters", *metrics, *without]
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    for name in systems_of(scores):
        lines.append("| " + " | ".join(_row(scores, name)) + " |")
    return "\n".join(lines)


def _row(scores: Sequence[Mapping[str, Any]], name: str) -> Iterator[str]:
    first = scores[0]
    entry = first["systems"].get(name, {})
    yield first["labels"].get(name, name)
    yield f"{entry['parameters']:,}" if entry.get("parameters") else ""
    for cell in CELLS:
        own = [score["cells"][cell][name] for score in scores]
        yield summary([one["r2"] for one in own], "{:.3f}")
        yield summary([one.get("mesh_mean_mm") for one in own], "{:.2f}")
    for cell in CELLS:
        if "unseen" in cell:
            yield summary([_r2_without_real(s, cell, name) for s in scores], "{:.3f}")


def _r2_without_real(score: Mapping[str, Any], cell: str, name: str) -> float | None:
    # SMPL alone has no offsets: its error is what there is to predict.
    return r2_of(
        [
            (one["frames"], one["errors"][name]["rms_mm"], one["errors"]["smpl"]["rms_mm"])
            for one in without_real(score, cell)
        ]
    )


def verdict(scores: Sequence[Mapping[str, Any]]) -> str:
    """In which cells `dsnet_plus` is the best, with every seed where there are several."""
    lost = [label for cell, label in CELLS.items() if not _wins(scores, cell)]
    outside = ", with its worst seed before any other's best" if len(scores) > 1 else ""
    if not lost:
        return f"DSNet+ has the least error in every cell{outside}."
    return f"DSNet+ has the least error{outside}, but not for: {'; '.join(lost)}."


def _wins(scores: Sequence[Mapping[str, Any]], cell: str) -> bool:
    """Whether its worst seed is better than the best of every other system.

    Standard deviations would not do: a system that diverges with one seed has one without end.
    """
    found = {n: [score["cells"][cell][n]["r2"] for score in scores] for n in systems_of(scores)}
    own = found.pop(BEST)
    return all(min(own) > max(others) for others in found.values())


def _described(score: Mapping[str, Any]) -> Iterator[str]:
    for name, entry in score["systems"].items():
        as_paper = "DSNet by the paper's words; its latents are the run's autoencoder's"
        clauses = "; ".join(entry["departures"]) or as_paper
        yield f"- **{entry['label']}** (`{name}`): {clauses}."
