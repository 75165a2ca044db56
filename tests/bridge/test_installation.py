"""What is not installed is named in one line that ends in the command which installs it."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.errors import DsnetError, MissingPackageError
from bridge.installation import how_to_install, require_packages_of, version_of
from tests.sources import ROOT


def execute(code: str, folder: Path, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    command, environment = [sys.executable, "-c", code], {**os.environ, "PYTHONPATH": str(path)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def test_of_a_checkout_its_folder_is_installed() -> None:
    command = f'{sys.executable} -m pip install --editable "{ROOT}[usd]"'
    assert how_to_install("usd") == f"Install the extra: {command}"


@pytest.mark.parametrize(
    ("origin", "source"),
    [
        ({"url": "file://{there}"}, '-m pip install "dsnet-skin[usd] @ file://{there}"'),
        ({"url": "file://{there}/gone.whl"}, 'in a checkout of this project: pip install ".[usd]"'),
        (
            {"url": "https://host/x", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}},
            '"dsnet-skin[usd] @ git+https://host/x@c0ffee"',
        ),
        (None, 'in a checkout of this project: pip install ".[usd]"'),
    ],
)
def test_of_an_installation_its_source_is(tmp_path: Path, origin: dict | None, source: str) -> None:
    (there := tmp_path / "there").mkdir()
    site = tmp_path / "site"
    shutil.copytree(ROOT / "bridge", site / "bridge", ignore=lambda *_: ["body", "report"])
    (described := site / "dsnet_skin-0.1.0.dist-info").mkdir()
    (described / "METADATA").write_text("Name: dsnet-skin\nVersion: 0.1.0\n")
    (described / "RECORD").write_text(f"{described.name}/direct_url.json,,\n" * bool(origin))
    if origin:
        (described / "direct_url.json").write_text(
            json.dumps(origin).replace("{there}", f"{there}")
        )
    code = "from bridge.installation import how_to_install; print(how_to_install('usd'))"
    said = execute(code, tmp_path, site)
    assert said.stdout.endswith(source.replace("{there}", f"{there}") + "\n"), said.stderr


def without(package: str, statement: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A statement in a process where a package is not found."""
    return execute(f"import sys; sys.modules[{package!r}] = None; {statement}", folder)


@pytest.mark.parametrize(
    ("package", "framework", "name"),
    [
        ("torch_align_ae", "torch", "SMPL"),
        ("torch_align_ae", "h5py", "MeshAutoencoder"),
        ("tf_dsnet", "tensorflow", "build_dsnet"),
    ],
)
def test_an_import_says_what_the_command_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, framework: str, name: str
) -> None:
    said = without(framework, f"from {package} import {name}", tmp_path).stderr.splitlines()[-1]
    monkeypatch.setitem(sys.modules, framework, None)
    with pytest.raises(ImportError) as caught:
        require_packages_of(package)
    assert isinstance(caught.value, DsnetError)
    assert said == f"bridge.errors.MissingPackageError: {caught.value}"
    assert said.endswith(how_to_install("train"))


def test_a_stream_needs_no_framework(tmp_path: Path) -> None:
    code = (
        "from dsnet import Stream; from tf_dsnet import StreamingPredictor as P; print(Stream, P)"
    )
    done = without("tensorflow", code, tmp_path)
    assert done.stdout.count("class") == 2, done.stderr


def test_it_is_an_import_error_and_survives_a_process() -> None:
    error = pickle.loads(pickle.dumps(MissingPackageError("a", "b", "c")))
    assert isinstance(error, ModuleNotFoundError)
    assert str(error) == "a; expected b. c"


def test_a_build_without_cuda_has_the_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (found := tmp_path / "framework_cpu-1.2.dist-info").mkdir()
    (found / "METADATA").write_text("Name: framework-cpu\nVersion: 1.2\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert version_of("framework") == "1.2"
    assert version_of("no-such-framework") is None


def test_the_bridge_offers_its_readers_and_loads_them_late() -> None:
    code = (
        "import sys, bridge; before = 'numpy' in sys.modules\n"
        "from bridge import load_motion, read_artifact, write_artifact\n"
        "print(before, load_motion('sample:walking').theta.shape[1])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "69"]
