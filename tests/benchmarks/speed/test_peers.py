"""Peers are timed on the same bodies, beside ours; those that are not installed are left out."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json

import numpy as np
import pytest

from benchmarks.speed import graphs, limits, peers, posing_peers
from benchmarks.speed.peers import PeersBenchConfig, main
from bridge import DsnetError
from dsnet.verify.draws import SMALL_WIDTHS

WITHOUT_WARNINGS = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")


@pytest.fixture
def small(tmp_path, monkeypatch):
    """Decoders of few numbers, one turn, and the file that is written."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    widths = (6890, *SMALL_WIDTHS[1:])
    architecture = {**graphs.ARCHITECTURE, "widths": widths}
    for module in (graphs, peers):
        monkeypatch.setattr(module, "ARCHITECTURE", architecture)
    monkeypatch.setattr(graphs, "INFERRED_WIDTHS", widths)
    monkeypatch.setattr(peers, "CASAS_OTADUY_WIDTHS", (20670, 8, 6, 100))
    monkeypatch.setattr(limits, "_SQUARE", 64)

    def measured(**options) -> dict:
        main(PeersBenchConfig(run="r", rounds=1, bodies=(2,), clock="processor", **options))
        return json.loads((tmp_path / "r" / "bench" / "peers.json").read_text())

    return measured


def test_ours_are_timed_without_any_peer(small, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    found = small()
    assert list(found["posing"]["2"]) == ["onnx", "torch"]
    decoders = found["decoding"]["2"]
    assert list(decoders) == [
        "paper_onnx",
        "paper_torch",
        "casas_otaduy_onnx",
        "casas_otaduy_torch",
    ]
    for group in (found["posing"]["2"], decoders):
        first = next(iter(group.values()))
        assert first["times_ours"] == 1
        for shares in group.values():
            assert list(shares) == ["times_ours", "times_moving", "times_multiplying", "ms"]
            assert min(shares.values()) > 0
            assert shares["ms"] == pytest.approx(shares["times_ours"] * first["ms"])


@WITHOUT_WARNINGS
@pytest.mark.parametrize(
    ("peer", "rows"),
    [("smplx", ["smplx"]), ("smplfitter", ["smplfitter_torch", "smplfitter_torchscript"])],
)
def test_a_peer_that_is_installed_has_its_rows(small, monkeypatch, peer, rows):
    pytest.importorskip(peer)
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name: importlib.machinery.ModuleSpec(name, None) if name == peer else None,
    )
    found = small()
    assert list(found["posing"]["2"])[2:] == rows
    assert peer in found["versions"]


def test_what_differs_is_not_compared():
    ones = np.ones((2, 5, 3))
    peers._require_same({"ours": ones, "theirs": ones + 1e-5})
    for other in (ones + 1e-3, ones * np.nan):
        with pytest.raises(DsnetError, match="theirs"):
            peers._require_same({"ours": ones, "theirs": other})


def test_bodies_are_given_with_hands_at_rest():
    bodies = posing_peers.DrawnBodies.drawn(np.random.default_rng(0), 3)
    given = bodies.as_smpl()
    np.testing.assert_array_equal(given["pose"][:, :66], bodies.theta[:, :66])
    np.testing.assert_array_equal(given["pose"][:, 66:], 0)
    np.testing.assert_array_equal(given["trans"], bodies.theta[:, 66:])
