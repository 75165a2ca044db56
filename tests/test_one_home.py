"""A fact stands in one place."""

from __future__ import annotations

import ast

from bridge import paper
from tests.sources import PACKAGES, ROOT, defined_names, parsed, source_files

# Numbers that mean the paper's wherever they stand; 22, 60 or 100 may count something else.
UNMISTAKABLE = {paper.N_VERTICES, 3 * paper.N_VERTICES, paper.INPUT_SIZE}
CONSTANTS = {name for name in vars(paper) if name.isupper()}
PAPER = ROOT / "bridge" / "paper.py"


def test_the_papers_constants_are_defined_once() -> None:
    others = [path for path in source_files(*PACKAGES, "benchmarks", "tools") if path != PAPER]
    second = {str(path): defined_names(path) & CONSTANTS for path in others}
    assert not {path: names for path, names in second.items() if names}


def test_the_papers_sizes_are_written_once() -> None:
    found = [
        f"{path}:{node.lineno}: {node.value}"
        for path in source_files(*PACKAGES, "benchmarks")
        if path != PAPER
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Constant) and type(node.value) is int and node.value in UNMISTAKABLE
    ]
    assert found == []


def test_the_records_of_the_paper_agree_with_the_constants() -> None:
    expected = {
        "vertices": paper.N_VERTICES,
        "mesh_size": 3 * paper.N_VERTICES,
        "joints": paper.N_JOINTS,
        "theta": paper.THETA_SIZE,
        "betas": paper.N_BETAS,
        "dsnet_input": paper.INPUT_SIZE,
        "latent_size": paper.LATENT_SIZE,
        "clip_frames": paper.CLIP_FRAMES,
        "casas_otaduy_widths": paper.CASAS_OTADUY_WIDTHS[1:],
        **paper.DSNET_WIDTHS,
    }
    records = {record.key: record.value for record in paper.NUMBERS}
    assert {key: records[key] for key in expected} == expected
