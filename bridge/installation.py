"""What is installed beside this distribution, and how what is missing is installed."""

from __future__ import annotations

import json
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from bridge.errors import MissingPackageError

DISTRIBUTION = "dsnet-skin"
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
    """The command that adds an extra to this installation, from where it came: no index has it."""
    checkout, origin = Path(__file__).parents[1], _origin()
    if (checkout / "pyproject.toml").is_file():
        source = f'--editable "{checkout}[{extra}]"'
    elif origin:
        source = f'"{DISTRIBUTION}[{extra}] @ {origin}"'
    else:
        return f'Install the extra, in a checkout of this project: pip install ".[{extra}]"'
    python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
    return f"Install the extra: {python} -m pip install {source}"


def version_of(package: str) -> str | None:
    """The installed version of a distribution, or of its build without CUDA."""
    for name in (package, f"{package}-cpu"):
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return None


def _origin() -> str | None:
    """URL of the folder, wheel or repository that was installed, if it is still there."""
    try:
        files = metadata.files(DISTRIBUTION) or ()
    except metadata.PackageNotFoundError:
        return None
    stated = [file for file in files if file.name == "direct_url.json"]
    if not stated:
        return None
    direct = json.loads(stated[0].read_text(encoding="utf-8"))
    if vcs := direct.get("vcs_info"):
        return f"{vcs['vcs']}+{direct['url']}@{vcs['commit_id']}"
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    parts = urlsplit(direct["url"])
    there = parts.scheme != "file" or Path(url2pathname(parts.path)).exists()
    return direct["url"] if there else None
