"""The built wheel in an environment that holds what it asks for and nothing else."""

from __future__ import annotations

import os
import subprocess
import venv
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

from bridge.runs import read_artifact
from tests.forged.amass import save, smplh
from tests.pages import python_blocks
from tests.sources import PACKAGES
from tools.built_wheel import asked_by, build_wheel

pytestmark = pytest.mark.slow
FRAMEWORKS = ("torch", "tensorflow", "keras", "h5py")


def required(lines: Iterable[str], seen: set[str]) -> Iterator[metadata.Distribution]:
    """What requirements without extras ask for, and what that asks for, as installed here."""
    for line in lines:
        requirement = Requirement(line)
        name = requirement.name.lower()
        if name in seen or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        seen.add(name)
        found = metadata.distribution(name)
        yield found
        yield from required(found.requires or (), seen)


def link(found: metadata.Distribution, site: Path) -> None:
    """Put an installed distribution's files below `site`."""
    tops = {file.parts[0] for file in found.files or () if file.parts[0] not in ("..", ".")}
    for top in tops - {"__pycache__"}:
        target = site / top
        if not target.exists():
            target.symlink_to(Path(str(found.locate_file(top))))


def execute(command: list, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command that finds no other packages than its environment's."""
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, cwd=folder, env=own, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel; its `bin`. No network: dependencies are linked."""
    folder = tmp_path_factory.mktemp("wheel")
    wheel = build_wheel(folder)
    venv.create(folder / "empty", with_pip=True)
    [site] = (folder / "empty" / "lib").glob("python*/site-packages")
    for found in required(asked_by(wheel), set()):
        link(found, site)
    install = ["-m", "pip", "--quiet", "install", "--no-deps", "--no-index", wheel]
    execute([folder / "empty" / "bin" / "python", *install], folder)
    return folder / "empty" / "bin"


def test_the_first_lines_of_readme_work(environment: Path, tmp_path: Path) -> None:
    code = python_blocks("README.md")[0] + "assert vertices_m.shape[1:] == (6890, 3)"
    done = execute([environment / "python", "-W", "error", "-c", code], tmp_path)
    assert done.returncode == 0, done.stderr
    command = [environment / "dsnet", "predict", "--motion", "sample:walking", "--out", "OUT"]
    assert execute(command, tmp_path).returncode == 0


def test_it_holds_no_framework(environment):
    code = f"import importlib.util as u; print([n for n in {FRAMEWORKS} if u.find_spec(n)])"
    assert execute([environment / "python", "-c", code], environment).stdout == "[]\n"


def test_a_motion_moves_there(environment, tmp_path):
    motion = save(tmp_path / "a_poses.npz", smplh(40, 60.0), gender="male")
    command = [environment / "dsnet", "predict", "--motion", motion, "--out", tmp_path / "out"]
    done = execute(command, tmp_path)
    assert done.returncode == 0, done.stderr
    made = read_artifact(tmp_path / "out", "prediction")
    assert (made.origin, made.manifest["predictor"]) == ("synthetic", "dsnet_plus")
    assert made.array("vertices").shape == (40, 6890, 3)
    assert np.abs(made.array("offsets")).max() < 0.1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a_poses.npz", "out"]


def test_training_there_says_what_to_install(environment, tmp_path):
    command = [environment / "dsnet", "train", "--run", "r"]
    done = execute(command, tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    command = done.stderr.strip().partition("Install the extra: ")[2]
    assert command.startswith(f"{environment}/python")
    assert '"dsnet-skin[train] @ file://' in command
    again = execute(["sh", "-c", f"{command} --no-deps --no-index --force-reinstall"], tmp_path)
    assert "Successfully installed dsnet-skin-" in again.stdout, again.stderr


def test_types_come_with_it(environment):
    [site] = (environment.parent / "lib").glob("python*/site-packages")
    assert all((site / package / "py.typed").is_file() for package in PACKAGES)
