"""What is not used is not loaded: counted in modules, which no busy machine changes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FILTERS = {"scipy.signal", "scipy.stats", "scipy.interpolate", "scipy.optimize"}
MESHES = {"trimesh", "networkx"}
PICTURES = {"matplotlib", "PIL"}
PAGES = {"jinja2", "markdown_it"}
PRODUCT = ("bridge", "dsnet", "tf_dsnet", "torch_align_ae")
LISTED = "; import sys; print(*sys.modules)"


def loaded_by(code: str, folder: Path) -> set[str]:
    """Modules that a process has loaded when it ends."""
    command = [sys.executable, "-W", "error", "-c", code + LISTED]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


def test_import_dsnet_loads_its_face_alone(tmp_path: Path) -> None:
    modules = loaded_by("import dsnet", tmp_path)
    assert sum(name.partition(".")[0] in PRODUCT for name in modules) <= 12
    assert not modules & {"numpy", "scipy", "onnx", "onnxruntime", "trimesh", "matplotlib", "tyro"}


def test_the_overview_of_commands_loads_no_command(tmp_path: Path) -> None:
    modules = loaded_by("from dsnet.cli import main; main(['--help'])", tmp_path)
    assert not modules & {"numpy", "scipy", "tyro"}


def test_a_point_cache_needs_no_pictures_meshes_or_filters(tmp_path: Path) -> None:
    command = ["export", "--to", "pc2", "--motion", "sample:walk_cycle", "--out", "cache"]
    modules = loaded_by(f"from dsnet.cli import main; main({command})", tmp_path)
    assert (tmp_path / "cache" / "body.pc2").is_file()
    unused = FILTERS | MESHES | PICTURES | PAGES
    assert not modules & (unused | {"torch", "tensorflow", "h5py"})


def test_prediction_draws_without_filters_meshes_or_pages(tmp_path: Path) -> None:
    command = ["predict", "--motion", "sample:walk_cycle", "--out", "walk"]
    modules = loaded_by(f"from dsnet.cli import main; main({command})", tmp_path)
    assert (tmp_path / "walk" / "strip.png").is_file()
    assert "matplotlib" in modules
    assert not modules & (FILTERS | MESHES | PAGES | {"matplotlib.pyplot"})


def test_a_prediction_in_memory_needs_no_locks(tmp_path: Path) -> None:
    code = "import dsnet; dsnet.animate(dsnet.load_motion('sample:walk_cycle')).arrays()"
    assert not loaded_by(code, tmp_path) & (FILTERS | MESHES | PICTURES | {"filelock", "tyro"})
