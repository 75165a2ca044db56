"""What is installed beside this distribution, and how what is missing is installed."""

from __future__ import annotations

import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from bridge.errors import MissingPackageError

_FRAMEWORKS = {
    "bridge.meshes": ("h5py",),
    "torch_align_ae": ("torch", "h5py"),
    "tf_dsnet": ("tensorflow",),
}
"""What the extra `train` brings for each package."""


def require_package(package: str, extra: str, whose: str) -> None:
    """Raise `MissingPackageError` where a package of an extra is missing that `whose` needs."""
    if find_spec(package) is None:
        raise MissingPackageError(
            f"an installation without {package}",
            f"{package}, which {whose} needs",
            how_to_install(extra),
        )


def require_packages_of(package: str) -> None:
    for framework in _FRAMEWORKS[package]:
        require_package(framework, "train", package)


def how_to_install(extra: str) -> str:
    """The command that adds an extra to this installation, in a checkout of the project."""
    checkout = Path(__file__).parents[1]
    if not (checkout / "pyproject.toml").is_file():
        return f'Install the extra, in a checkout of this project: pip install ".[{extra}]"'
    python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
    return f'Install the extra: {python} -m pip install --editable "{checkout}[{extra}]"'


def version_of(package: str) -> str | None:
    """The installed version of a distribution, or of its build without CUDA."""
    for name in (package, f"{package}-cpu"):
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return None
