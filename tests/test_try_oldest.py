"""The oldest frameworks: read from the project's file; what cannot be had is no failure."""

from __future__ import annotations

import re
import subprocess

import pytest

from tools import try_oldest


def test_the_oldest_are_those_of_the_extra_and_not_newer_than_the_pinned():
    oldest = try_oldest.oldest_frameworks((try_oldest.ROOT / "pyproject.toml").read_text())
    pinned = (try_oldest.ROOT / "constraints.txt").read_text()
    assert len(oldest) == 2
    for line in oldest:
        name, _, version = line.partition("==")
        (newest,) = re.findall(rf"^{name}==([\d.]+)", pinned, re.MULTILINE)
        assert [*map(int, version.split("."))] <= [*map(int, newest.split("."))]


@pytest.mark.parametrize(
    ("failing", "error", "fine", "said"),
    [
        (
            "install",
            "no wheel for x",
            True,
            "not tried, for packages cannot be had: no wheel for x",
        ),
        ("install", "ERROR: ResolutionImpossible: x", False, "exclude one another"),
        ("no:cacheprovider", "1 failed", False, "tests failed"),
        ("nothing", "", True, "keras==3.5: 5 passed"),
    ],
)
def test_only_what_cannot_be_had_is_an_excuse(
    failing, error, fine, said, monkeypatch, capsys, tmp_path
):
    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        bad = failing in command
        return subprocess.CompletedProcess(command, int(bad), "5 passed", f"\n{error}" * bad)

    monkeypatch.setattr(try_oldest, "run", run)
    assert try_oldest.works(["keras==3.5"], ["numpy"], ["tests"], tmp_path) == fine
    assert said in capsys.readouterr().out
