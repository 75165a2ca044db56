"""The two frameworks never meet in one process, the bridge needs neither, and is layered."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterable
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.sources import PACKAGES, ROOT, imported_modules, source_files

NO_PRODUCT = {"benchmarks", "tools", "tests"}
FORBIDDEN = {
    "bridge": {"torch", "tensorflow", "keras", "tf_dsnet", "torch_align_ae"},
    "torch_align_ae": {"tensorflow", "keras", "tf_dsnet"},
    "tf_dsnet": {"torch", "torch_align_ae"},
}
# A folder imports those before it. Files in none, as paper and errors, stand before all of them;
# what the package offers and cli, the command, after all.
ORDER = [
    "", "runs", "body", "motion", "exchange", "tissue", "measure", "report", "markers", "runtime",
    "fitting", "export", "view", "verify", "__init__.py", "cli.py",
]  # fmt: skip
THIRD_PARTIES = {
    "": set(),
    "__init__.py": set(),
    "cli.py": {"tyro"},
    "runs": {"filelock", "numpy", "ray", "threadpoolctl", "tqdm"},
    "body": {"numpy", "safetensors", "scipy", "trimesh"},
    "motion": {"numpy", "scipy"},
    "exchange": {"numpy", "safetensors"},
    "tissue": {"numpy", "scipy"},
    "runtime": {"matplotlib", "numpy", "onnx", "onnxruntime", "tyro"},
    "markers": {"numpy", "scipy"},
    "fitting": {"numpy", "scipy"},
    "export": {
        "PIL",
        "alembic3d",
        "imath",
        "imageio_ffmpeg",
        "matplotlib",
        "numpy",
        "onnx",
        "pxr",
        "scipy",
        "trimesh",
    },
    "view": {"numpy", "scipy"},
    "measure": {"numpy", "scipy"},
    "verify": {"numpy", "tyro"},
    "report": {"embreex", "jinja2", "markdown_it", "matplotlib", "numpy", "scipy", "tyro"},
}


def folder_of(path: Path) -> str:
    """The bridge's folder that holds a file; empty for the files beside the folders, but cli."""
    first, *below = path.relative_to(ROOT / "bridge").parts
    return first if below or first in ORDER else ""


def upward(folder: str, modules: Iterable[str]) -> list[str]:
    """Those modules that a file in one of the bridge's folders must not import."""
    later = ORDER[ORDER.index(folder) + 1 :]
    inner = [name.split(".") for name in modules if name.startswith("bridge.")]
    return [".".join(parts) for parts in inner if parts[1] in (*later, "cli")]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_source_file_imports_the_other_side_or_what_is_outside(package: str) -> None:
    for path in source_files(package):
        found = {name.partition(".")[0] for name in imported_modules(path)}
        assert not found & (FORBIDDEN[package] | NO_PRODUCT), path


def test_the_bridges_folders_import_in_one_direction() -> None:
    files = source_files("bridge")
    found = {path: upward(folder_of(path), imported_modules(path)) for path in files}
    assert not {str(path): names for path, names in found.items() if names}


def test_no_files_import_one_another_in_a_circle() -> None:
    """Not even inside functions; a package's name stands for its `__init__.py`."""
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in source_files(*PACKAGES)
    }
    assert len(modules) > 100
    TopologicalSorter(
        {name: set(imported_modules(path)) & {*modules} - {name} for name, path in modules.items()}
    ).prepare()


def test_the_page_shows_this_order() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^`.+?` < .+$", page, re.MULTILINE)
    assert re.findall(r"`(\w+)`", line) == ORDER[1:-2]
    drawn = re.findall(r"^ {8}(\w+)/ ", page, re.MULTILINE)
    assert drawn == ORDER[1:-2]


def test_every_folder_of_the_bridge_has_its_place() -> None:
    assert {folder_of(path) for path in source_files("bridge")} == set(ORDER)


@pytest.mark.parametrize("folder", THIRD_PARTIES)
def test_third_parties_are_those_of_the_folder(folder: str) -> None:
    own = {"bridge", "torch_align_ae", "tf_dsnet"} | sys.stdlib_module_names
    files = [path for path in source_files("bridge") if folder_of(path) == folder]
    found = {name.partition(".")[0] for path in files for name in imported_modules(path)}
    assert found - own == THIRD_PARTIES[folder]


def test_an_import_inside_a_function_is_seen(tmp_path: Path) -> None:
    source = tmp_path / "source.py"
    source.write_text("def f():\n    import torch.nn\n    from dsnet.report.bodies import Scene\n")
    names = list(imported_modules(source))
    assert names == ["torch.nn", "dsnet.report.bodies"]
    assert upward("motion", names) == ["dsnet.report.bodies"]
    assert upward("report", names) == []
    assert upward("", names) == ["dsnet.report.bodies"]
    assert upward("cli.py", names) == []
    assert upward("verify", ["dsnet.cli"]) == ["dsnet.cli"]


@pytest.mark.parametrize(
    ("modules", "absent"),
    [
        (
            "dsnet.cli, bridge.exchange, dsnet.prediction.stage_predict, tf_dsnet,"
            " dsnet.stages.stage_infer",
            "torch tensorflow keras",
        ),
        (
            "dsnet.exporters.stage_export",
            "torch tensorflow keras pxr alembic3d imageio_ffmpeg embreex",
        ),
        ("dsnet.view.stage_view", "torch tensorflow keras onnxruntime"),
        ("torch_align_ae", "tensorflow keras"),
        ("dsnet.stages.stage_train", "torch"),
    ],
)
def test_importing_loads_only_its_own_framework(modules: str, absent: str) -> None:
    code = f"import sys, {modules}; sys.exit(bool(set({absent.split()!r}) & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)
