"""docs/markers.md: what the packaged model does on a woman's skin, and fits of known flesh."""

from __future__ import annotations

from benchmarks.skin_markers.recovery import table
from tools.pages.blocks import load


def bust() -> dict[str, str]:
    """Left and right, up and down: mm of hers, of the pose alone and of the whole, and its R²."""
    of_file, bony = (
        [row for row in found["rows"] if row["region"].startswith("bust")]
        for found in load("skin_markers/markers").values()
    )
    both = {
        "hers": [f"{row['real']['peak_to_peak_mm'][1]:.0f}" for row in of_file],
        "pose": [f"{row['pose_peak_to_peak_up_mm']:.0f}" for row in of_file],
        "moved": [f"{row['total_peak_to_peak_up_mm']:.0f}" for row in bony],
        "r2": [f"{row['total_r2_up']:.2f}" for row in bony],
    }
    return {name: " and ".join(sides) for name, sides in both.items()}


def numbers() -> str:
    """Her bust, and the model's."""
    found = bust()
    return (
        f"Her bust moves {found['hers']} mm up and down. AMASS's pose alone moves it "
        f"{found['pose']} mm. On a pose by markers on bone\n"
        f"`dsnet_plus` moves it {found['moved']} mm: R² of the whole {found['r2']}.\n"
    )


def fitted() -> str:
    """R² on a pose that was fitted to all markers, to that on one by markers on bone."""
    said = []
    for fit, bony in (
        found.values() for found in load("skin_markers/marker_pose")["motions"].values()
    ):
        keys = ("r2_bust_offsets", "r2_bust_seen_up", "r2_offsets")
        said.append([f"{fit[key]:.2f} to {bony[key]:.2f}" for key in keys])
        said[-1].append(f"{fit['r2_bust_pose_alone']:.2f}")
    (offsets, seen, whole, alone), dancing = said
    return (
        f"jumping jacks: bust's offsets {offsets}, bust as seen {seen} (the fitted pose alone: "
        f"{alone}), all offsets {whole};\n"
        "dancing: {0}, {1} ({3}), {2}.\n".format(*dancing)
    )


def recovery() -> str:
    """Errors of fits whose flesh is known."""
    return table(load("skin_markers/recovery"))
