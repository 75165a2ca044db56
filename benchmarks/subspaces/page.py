"""The comparison of subspaces, written as a page and drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from benchmarks.subspaces.results import SUMMARY, read_summary
from dsnet.pictures.panels import new_figure, save_figure
from dsnet.report.curves import finish_axes

# Okabe and Ito's colours, told apart by every reader; line styles do it in print.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#777777")
_LINES = ("-", "-.", ":")
_HEAD = ("code", "numbers", "parameters", "R², validation", "mm, validation", "R², held out",
         "mm, held out", "rate", "steps (best)", "s a step", "ms to decode 1, 64")  # fmt: skip
_PAGE = """\
# Subspaces of soft-tissue offsets ({data} data)

{table}

R² of what a code gives back of the aligned offsets (`{aligner}` aligner), and mean, 95 % and
largest distance in millimetres, over the vertices of validation frames ({split}-level split) and of
the sequences that nothing was fitted to. *Numbers*: kept of a mesh. PCA's parameters are its mean
and its components. Every network takes {steps} steps of {batch_size} frames in the same order, and
is scored with its weights of the least validation loss ({validation_frames} frames, every
{validate_every} steps). Where the rate is searched for, {search_steps} steps are taken at each of
{rates}, and the least validation loss after them decides. Rows of more steps are trainings of
their own: the rate falls along a cosine, so none is a shorter one continued. Seconds and
milliseconds are medians on {machine}, with {threads}; the machine's load was {load}.
Run `{run}`, seed {seed}. Made by {commands}.

![Training curves](subspaces.png)
"""


def markdown(folder: Path) -> str:
    """A page with one table: the folder's rows, and longer trainings from the folders in it."""
    summary, rows = read_summary(folder)
    order = [(row["code"], row["size"]) for row in rows]
    for longer in sorted(folder.glob(f"*/{SUMMARY}")):
        rows += read_summary(longer.parent)[1]
    rows.sort(key=lambda row: order.index((row["code"], row["size"])))
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" + "|---:" * (len(_HEAD) - 1) + "|"]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in rows]
    settings = summary["settings"]
    return _PAGE.format(
        **{**settings, "rates": ", ".join(f"{rate:g}" for rate in settings["rates"])},
        table="\n".join(lines),
        commands=", ".join(f"`{command}`" for command in _commands_of(rows)),
        **_machine(rows),
    )


def _commands_of(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Those that made the rows, each once."""
    arguments = (row["provenance"]["command"][1:] for row in rows)
    return list(dict.fromkeys(" ".join(["python -m benchmarks.subspaces", *a]) for a in arguments))


def draw(path: Path, folder: Path) -> None:
    """Training curves of the largest size: what is lost of the validation frames, over steps."""
    summary, rows = read_summary(folder)
    size = max((row["size"] for row in rows), default=0)
    shown = [row for row in rows if row["size"] == size]
    origin = summary["settings"]["data"]
    figure = new_figure(12.0, 4.6, title=f"Codes of {size} numbers in training", origin=origin)
    axes = figure.subplots()
    styles = zip(cycle(_COLOURS), cycle(_LINES), strict=False)
    for row, (colour, line) in zip((r for r in shown if "curve" in r), styles, strict=False):
        lost = [1 - r2 for r2 in row["curve"]["r2"]]
        axes.plot(row["curve"]["steps"], lost, line, color=colour, label=row["label"])
    for row in shown:
        if "scored_r2" in row:
            axes.axhline(1 - row["scored_r2"], color="black", linestyle="--", label=row["label"])
    if shown:
        axes.set_yscale("log")
    finish_axes(axes, "step", "1 - R² of validation frames", legend=False)
    figure.legend(loc="outside right center", fontsize=8, frameon=False)
    save_figure(figure, path)


def _cells(row: Mapping[str, Any]) -> list[str]:
    decode = row["decode_ms"]
    return [
        *_code_cells(row),
        *_error_cells(row["validation"]),
        *_error_cells(row["held_out"]),
        *_trained(row),
        ", ".join(f"{value:.2f}" for value in decode.values()),
    ]


def _code_cells(row: Mapping[str, Any]) -> list[str]:
    """Label, size and parameters."""
    return [row["label"], str(row["size"]), f"{row['parameters']:,}"]


def _error_cells(found: Mapping[str, float] | None) -> list[str]:
    """R², and mean, 95 % and largest distance in millimetres; empty where there are no frames."""
    if found is None:
        return ["", ""]
    distances = " / ".join(f"{found[key]:.2f}" for key in ("mean_mm", "p95_mm", "max_mm"))
    return [f"{found['r2']:.4f}", distances]


def _trained(row: Mapping[str, Any]) -> list[str]:
    if "curve" not in row:
        return ["", "", ""]
    step_s = "" if row["step_s"] is None else f"{row['step_s']:.2f}"
    steps = f"{row['steps_taken']} ({row['best_step']})"
    return [f"{row['learning_rate']:g}", steps, step_s]


def _machine(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Where the rows' times were measured."""
    threads = sorted({row["threads"] for row in rows})
    loads = [row["load"] for row in rows]
    return {
        "machine": "; ".join(sorted({_place(row) for row in rows})),
        "threads": " or ".join(f"{n} thread{'s' * (n != 1)}" for n in threads),
        "load": f"{min(loads):.1f} to {max(loads):.1f}" if loads else "",
    }


def _place(row: Mapping[str, Any]) -> str:
    gpu = row.get("gpu")
    return row["provenance"]["machine"] + (f" and {gpu}" if gpu else "")
