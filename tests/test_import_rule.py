"""Three leaves on one trunk: all packages import `bridge`, and no other one of the product."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.sources import PACKAGES, ROOT, imported_modules, parsed, source_files
from tools.draw_architecture import PICTURE, drawn

NO_PRODUCT = {"benchmarks", "tools", "tests"}
FRAMEWORK_OF = {"torch_align_ae": "torch", "tf_dsnet": "tensorflow"}
FRAMEWORKS = {"torch", "tensorflow", "keras"}
ALLOWED = {
    "bridge": {"bridge"},
    "dsnet": {"bridge", "dsnet"},
    "torch_align_ae": {"bridge", "torch_align_ae", "torch"},
    "tf_dsnet": {"bridge", "tf_dsnet", "tensorflow", "keras"},
}
"""What a package's files import of the packages and frameworks."""
# A folder imports those before it. Files beside the folders of `bridge` stand before all of them,
# what the package offers and the command after all.
ORDER = {
    "bridge": ("", "runs", "body", "motion", "meshes", "exchange", "tissue", "__init__.py"),
    "dsnet": (
        "pictures", "onnx", "synthetic", "evaluation", "markers", "prediction", "stream",
        "fitting", "exporters", "blender", "view", "verify", "report", "stages",
        "__init__.py", "command_line.py", "cli.py",
    ),
}  # fmt: skip
THIRD_PARTIES = {
    "bridge": {
        "": set(),
        "__init__.py": set(),
        "runs": {"filelock", "numpy", "ray", "threadpoolctl", "tqdm"},
        "body": {"numpy", "safetensors", "scipy"},
        "motion": {"numpy", "scipy", "ufbx"},
        "meshes": {"h5py", "numpy"},
        "exchange": {"numpy", "safetensors", "tyro"},
        "tissue": {"numpy", "scipy"},
    },
    "dsnet": {
        "__init__.py": set(),
        "cli.py": {"tyro"},
        "command_line.py": {"tyro"},
        "onnx": {"numpy", "onnx", "onnxruntime"},
        "synthetic": {"h5py", "numpy", "scipy", "tyro"},
        "evaluation": {"numpy", "scipy"},
        "pictures": {"PIL", "embreex", "jinja2", "matplotlib", "numpy", "scipy"},
        "report": {"PIL", "markdown_it", "matplotlib", "numpy", "tyro"},
        "markers": {"matplotlib", "numpy", "scipy"},
        "prediction": {"numpy", "onnx", "scipy", "trimesh"},
        "stream": {"numpy"},
        "fitting": {"numpy", "scipy"},
        "exporters": {
            "PIL", "alembic3d", "imath", "imageio_ffmpeg", "matplotlib", "numpy", "onnx", "pxr",
            "scipy", "trimesh",
        },
        "blender": {"bpy", "numpy", "scipy"},
        "view": {"numpy", "scipy"},
        "verify": {"numpy", "scipy", "tyro"},
        "stages": {"numpy", "tyro"},
    },
}  # fmt: skip
NAMES_MODULES = {
    "dsnet/__init__.py",
    "dsnet/cli.py",
    "dsnet/exporters/formats.py",
    "dsnet/prediction/runtimes.py",
    "dsnet/stages/frameworks.py",
    "dsnet/verify/engines.py",
    "tf_dsnet/__init__.py",
}
"""Files that name modules of another package in strings: the command, and tables of plug-ins."""


def folder_of(path: Path) -> str:
    """The folder of a file; its name for one in `ORDER`, empty for others beside the folders."""
    package, first, *below = path.relative_to(ROOT).parts
    return first if below or first in ORDER[package] else ""


def upward(package: str, folder: str, modules: Iterable[str]) -> list[str]:
    """Those modules that a file in one of a package's folders must not import."""
    order = ORDER[package]
    later = {name.removesuffix(".py") for name in order[order.index(folder) + 1 :]}
    inner = [name.split(".") for name in modules if name.startswith(f"{package}.")]
    return [".".join(parts) for parts in inner if parts[1] in later]


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_the_bridge_and_never_each_other(package: str) -> None:
    refused = ({*PACKAGES} | FRAMEWORKS | NO_PRODUCT) - ALLOWED[package]
    for path in source_files(package):
        found = {name.partition(".")[0] for name in imported_modules(path)}
        assert not found & refused, path


def test_only_tables_name_modules_of_other_packages() -> None:
    naming = set()
    for path in source_files(*PACKAGES):
        own = path.relative_to(ROOT).parts[0]
        others = "|".join({*PACKAGES} - {own})
        for node in ast.walk(parsed(path)):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and re.fullmatch(rf"({others})(\.\w+)+", text):
                naming.add(path.relative_to(ROOT).as_posix())
    assert naming <= NAMES_MODULES


@pytest.mark.parametrize("package", FRAMEWORK_OF)
def test_files_of_a_frameworks_package_need_the_framework(package: str) -> None:
    """Directly, or by another file of the package; what needs neither belongs elsewhere."""
    for path in source_files(package):
        found = {name.partition(".")[0] for name in imported_modules(path)}
        assert path.name == "__init__.py" or found & {FRAMEWORK_OF[package], package}, path


@pytest.mark.parametrize("package", ORDER)
def test_folders_import_in_one_direction(package: str) -> None:
    files = source_files(package)
    found = {p: upward(package, folder_of(p), imported_modules(p)) for p in files}
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


@pytest.mark.parametrize("package", ORDER)
def test_the_page_shows_this_order(package: str) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    folders = [name for name in ORDER[package] if name and not name.endswith(".py")]
    (drawn,) = re.findall(rf"^    {package}/ .*\n((?: {{8}}\w+/ .*\n)+)", page, re.MULTILINE)
    assert re.findall(r"^ {8}(\w+)/", drawn, re.MULTILINE) == folders


def test_the_picture_shows_the_imports() -> None:
    assert PICTURE.read_text(encoding="utf-8") == drawn()


@pytest.mark.parametrize("package", ORDER)
def test_every_folder_has_its_place(package: str) -> None:
    assert {folder_of(path) for path in source_files(package)} == set(ORDER[package])


@pytest.mark.parametrize(
    ("package", "folder"),
    [(p, folder) for p, folders in THIRD_PARTIES.items() for folder in folders],
)
def test_third_parties_are_those_of_the_folder(package: str, folder: str) -> None:
    files = [path for path in source_files(package) if folder_of(path) == folder]
    found = {name.partition(".")[0] for path in files for name in imported_modules(path)}
    assert found - {*PACKAGES} - sys.stdlib_module_names == THIRD_PARTIES[package][folder]


@pytest.mark.parametrize(
    ("modules", "absent"),
    [
        (
            "dsnet.cli, bridge.exchange, dsnet.prediction.stage_predict, tf_dsnet,"
            " dsnet.stages.stage_infer, dsnet.stages.stage_train",
            "torch tensorflow keras",
        ),
        (
            "dsnet.exporters.stage_export",
            "torch tensorflow keras pxr alembic3d imageio_ffmpeg embreex",
        ),
        ("dsnet.view.stage_view", "torch tensorflow keras onnxruntime"),
        ("torch_align_ae", "tensorflow keras"),
        ("tf_dsnet.train_networks", "torch"),
    ],
)
def test_importing_loads_only_its_own_framework(modules: str, absent: str) -> None:
    code = f"import sys, {modules}; sys.exit(bool(set({absent.split()!r}) & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)
