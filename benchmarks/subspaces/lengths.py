"""`python -m benchmarks.subspaces.lengths --out FILE.md --folders DIR ...`: the same, longer.

Each folder is one of `benchmarks.subspaces`, and they differ in the number of steps only. The rate
falls along a cosine, so a longer training is not a shorter one continued, and what one more
training of four times the steps gains says whether the curve has reached its plateau.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.subspaces.page import COLOURS, code_cells, commands_of, error_cells
from benchmarks.subspaces.results import SUMMARY, listed, read_summary
from bridge.errors import DsnetError
from bridge.paper import LATENT_SIZE
from bridge.report.curve_figures import finish_axes
from bridge.report.panels import new_figure, save_figure
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process

_OF_LENGTH = ("steps", "search_steps", "validate_every")
_LINES = (":", "-.", "--", "-")
_HEAD = ("code", "numbers", "parameters", "steps", "rate", "R² before", "R² after",
         "R², validation", "mm, validation", "R², held out", "mm, held out")  # fmt: skip
_PAGE = """\
# Longer training of the codes of {size} numbers ({data} data)

{table}

As [the table of all codes](subspaces.md), with more steps. *Before* and *after*: R² on the {frames}
validation frames that the curve is of, before the first step and with the weights of the least
loss; the other columns are of all validation frames and of sequences that nothing was fitted to.
Run `{run}`, seed {seed}. Made by {commands}, then `{command}`.

![Training curves]({figure})
"""


@dataclass(frozen=True)
class LengthsConfig:
    """Tabulate and draw what the folders hold."""

    out: Path
    """The page, a .md; its figure is beside it."""
    folders: tuple[Path, ...]
    """Of `benchmarks.subspaces`, the one with PCA among them."""


def main(config: LengthsConfig) -> None:
    """Write the page and its figure.

    Raises
    ------
    DsnetError
        If a folder is none of `benchmarks.subspaces`, or differs in more than its steps.
    """
    figure = config.out.with_suffix(".png")
    write_text_atomically(config.out, markdown(config.out, config.folders))
    draw(figure, config.folders)


def markdown(out: Path, folders: Sequence[Path]) -> str:
    """The page `out` of these folders."""
    settings, rows = _rows_of(folders)
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" + "|---:" * (len(_HEAD) - 1) + "|"]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in rows]
    named = " ".join(folder.as_posix() for folder in folders)
    return _PAGE.format(
        **settings,
        size=LATENT_SIZE,
        frames=settings["validation_frames"],
        table="\n".join(lines),
        commands=", ".join(f"`{command}`" for command in commands_of(rows)),
        command=f"python -m benchmarks.subspaces.lengths --out {out.as_posix()} --folders {named}",
        figure=out.with_suffix(".png").name,
    )


def draw(path: Path, folders: Sequence[Path]) -> None:
    """What is lost of the validation frames, over the steps of every training."""
    settings, rows = _rows_of(folders)
    trained = [row for row in rows if "curve" in row]
    colours = dict(zip(dict.fromkeys(row["code"] for row in trained), COLOURS, strict=False))
    lengths = sorted({row["steps_taken"] for row in trained})
    title = f"Codes of {LATENT_SIZE} numbers, trained for {_numbers(lengths)} steps"
    figure = new_figure(12.0, 5.0, title=title, origin=settings["data"])
    axes = figure.subplots()
    for row in trained:
        curve, last = row["curve"], row["steps_taken"] == lengths[-1]
        lost = [1 - r2 for r2 in curve["r2"]]
        line = _LINES[max(lengths.index(row["steps_taken"]) - len(lengths), -len(_LINES))]
        label = f"{row['label']}: {row['steps_taken']} steps"
        width = 1.8 if last else 1.2
        colour = colours[row["code"]]
        axes.plot(curve["steps"], lost, line, color=colour, label=label, linewidth=width)
    for row in rows:
        if "scored_r2" in row:
            axes.axhline(1 - row["scored_r2"], color="black", linestyle="--", label=row["label"])
    axes.set_yscale("log")
    axes.set_xscale("symlog", linthresh=20)
    axes.set_xlim(left=0)
    finish_axes(axes, "step", "1 - R² of validation frames", legend=False)
    figure.legend(loc="outside right center", fontsize=7.5, frameon=False)
    save_figure(figure, path)


def _numbers(lengths: Sequence[int]) -> str:
    return ", ".join(f"{length:,}" for length in lengths)


def _rows_of(folders: Sequence[Path]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What the folders have in common, and their rows of the paper's size, by code."""
    found = list(_summaries(folders))
    common = _without_length(found[0][0])
    for folder, (settings, _) in zip(folders, found, strict=True):
        other = {key: value for key, value in _without_length(settings).items()
                 if common.get(key) != value}  # fmt: skip
        if other:
            raise DsnetError(
                f"{folder} with {listed(other)}",
                f"{listed({key: common.get(key) for key in other})}, as {folders[0]} has",
                "Name folders that differ in their steps only.",
            )
    rows = [row for _, part in found for row in part if row["size"] == LATENT_SIZE]
    order = list(dict.fromkeys(row["code"] for row in rows))
    return common, sorted(rows, key=lambda r: (order.index(r["code"]), r.get("steps_taken", 0)))


def _summaries(
    folders: Sequence[Path],
) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    if not folders:
        raise DsnetError("no --folders", "at least one", "Name folders of benchmarks.subspaces.")
    for folder in folders:
        if not (folder / SUMMARY).is_file():
            raise DsnetError(
                f"{folder} without {SUMMARY}",
                "a folder of benchmarks.subspaces",
                "Make it by python -m benchmarks.subspaces.",
            )
        summary, rows = read_summary(folder)
        yield summary["settings"], rows


def _without_length(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in settings.items() if key not in _OF_LENGTH}


def _cells(row: Mapping[str, Any]) -> list[str]:
    curve = row.get("curve", {}).get("r2")
    scored = [f"{curve[0]:.4f}", f"{max(curve):.4f}"] if curve else ["", f"{row['scored_r2']:.4f}"]
    trained = [str(row["steps_taken"]), f"{row['learning_rate']:g}"] if curve else ["", ""]
    return [
        *code_cells(row),
        *trained,
        *scored,
        *error_cells(row["validation"]),
        *error_cells(row["held_out"]),
    ]


if __name__ == "__main__":
    run_as_process(LengthsConfig, main)
