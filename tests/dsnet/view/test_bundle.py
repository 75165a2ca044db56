"""What is shipped is what its sources make."""

from __future__ import annotations

import gzip
import hashlib
import shutil
import subprocess
from pathlib import Path

import pytest

from dsnet.view.scene import BUNDLE

SOURCES = BUNDLE.parent / "web"


def test_the_lock_names_no_host():
    assert "resolved" not in (SOURCES / "package-lock.json").read_text()


@pytest.mark.browser
def test_the_bundle_is_made_of_its_sources(tmp_path: Path):
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("npm is not installed")
    web = tmp_path / "web"
    shutil.copytree(SOURCES, web, ignore=shutil.ignore_patterns("node_modules"))
    cache = ("--cache", str(tmp_path / "cache"), "--no-audit", "--no-fund")
    done = subprocess.run(
        [npm, "ci", *cache], cwd=web, capture_output=True, text=True, timeout=300, check=False
    )
    if done.returncode:
        pytest.skip(f"npm's packages cannot be fetched: {done.stderr[-200:]}")
    subprocess.run([npm, "run", "build", "--", str(tmp_path / "made")], cwd=web, check=True)
    assert (tmp_path / "made" / "page.html").read_bytes() == (BUNDLE / "page.html").read_bytes()
    made, shipped = (
        hashlib.sha256(gzip.decompress((folder / "runtime.wasm.gz").read_bytes())).hexdigest()
        for folder in (tmp_path / "made", BUNDLE)
    )
    assert made == shipped
