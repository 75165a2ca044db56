"""The laws to test on stand apart: the product does not know them, nor they one another."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from dsnet.synthetic.stage_corpus import PROFILES
from tests.sources import PACKAGES, ROOT, imported_modules, parsed, source_files

CORPUS = ROOT / "dsnet" / "synthetic"
REGISTRY = "dsnet.synthetic.tissue_laws"
_SHARED = {"simulation": {"skin"}, "motions.plan": {"GRAVITY_M_S2"}}
LAWS = {
    "second": _SHARED,
    "third": _SHARED | {"tissue_parameters": {"smooth_over_surface"}},
}
"""And what each may share with the product's own law."""


def outside() -> list[Path]:
    return [path for path in source_files(*PACKAGES) if CORPUS not in path.parents]


def test_nothing_outside_the_corpus_chooses_a_law():
    for path in outside():
        assert REGISTRY not in set(imported_modules(path)), path


@pytest.mark.parametrize("law", LAWS)
def test_it_shares_nothing_with_other_laws_but_body_surface_and_skinning(law):
    found: dict[str, set[str]] = {}
    files = [*(ROOT / "benchmarks" / "laws").glob(f"{law}_tissue*.py")]
    assert len(files) > 1
    for path in files:
        for node in ast.walk(parsed(path)):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            if node.module.startswith("benchmarks"):
                assert node.module.startswith(f"benchmarks.laws.{law}_tissue"), path
            if node.module.startswith("dsnet.synthetic"):
                name = node.module.removeprefix("dsnet.synthetic.")
                found.setdefault(name, set()).update(alias.name for alias in node.names)
    assert found == LAWS[law]


def test_only_evaluation_and_report_ask_with_which_law_a_corpus_was_made():
    """So no training's settings depend on it: of a manifest only this text could tell."""
    naming = {ROOT / "dsnet" / "evaluation", ROOT / "dsnet" / "report"}
    for path in outside():
        if naming & set(path.parents):
            continue
        texts = {node.value for node in ast.walk(parsed(path)) if isinstance(node, ast.Constant)}
        assert not {"tissue", *LAWS} & texts, path


def test_no_profile_is_made_with_any():
    assert {(config.tissue, config.form) for config in PROFILES.values()} == {("own", "clean")}
