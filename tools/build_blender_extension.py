"""Build the Blender extension: a zip with this project's wheel and those that it needs to predict.

    python -m tools.build_blender_extension OUT.zip [--platform linux-x64 ...] [--python 3.11]

Blender installs it by *Edit > Preferences > Get Extensions > Install from Disk*. Wheels are those
of the index that pip uses; NumPy is Blender's own. One zip is for one Python: Blender 4.2 to 5.0
have 3.11, from 5.1 on 3.13. Some 100 MB a platform.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from bridge import __version__
from tools.built_wheel import ROOT, build_wheel

MANIFEST = ROOT / "dsnet" / "blender" / "blender_manifest.toml"
PLATFORMS = {
    "linux-x64": [f"manylinux_2_{n}_x86_64" for n in (28, 27, 24, 17)] + ["manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": [f"macosx_{n}_0_{chip}" for n in (14, 13, 12, 11) for chip in
                    ("arm64", "universal2")],
}  # fmt: skip
"""What pip calls Blender's platforms."""
PYTHONS = {
    "3.11": (["numpy==1.26.4", "scipy<1.16"], {"min": "4.2.0", "max": "5.1.0"}),
    "3.13": (["numpy>=2"], {"min": "5.1.0"}),
}
"""What fits Blender's NumPy, and the Blenders that have this Python."""
NEEDED = ("filelock", "onnx", "onnxruntime", "safetensors", "scipy", "threadpoolctl", "tqdm")
"""To predict, of what `pyproject.toml` asks for: pictures and the command need the rest."""
BLENDERS_OWN = "numpy"
ENTRY = '''"""Soft tissue: everything is in the wheel of dsnet."""

from dsnet.blender.addon import register, unregister

__all__ = ["register", "unregister"]
'''


def main() -> int:
    """Build it; the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--platform", nargs="+", choices=PLATFORMS, default=["linux-x64"])
    parser.add_argument("--python", choices=PYTHONS, default="3.11")
    given = parser.parse_args()
    build(given.out, given.platform, given.python)
    with zipfile.ZipFile(given.out) as archive:
        for entry in archive.infolist():
            print(f"{entry.file_size / 1e6:7.2f} MB  {entry.filename}")
    print(f"{given.out.stat().st_size / 1e6:7.2f} MB  {given.out}")
    return 0


def build(out: Path, platforms: list[str], python: str) -> Path:
    """Write the zip `out`; OSError if wheels cannot be had."""
    with tempfile.TemporaryDirectory(prefix="extension_") as name:
        folder = Path(name)
        wheels = [build_wheel(folder)]
        for platform in platforms:
            wheels += download(folder / "wheels", platform, python)
        wheels = sorted({wheel.name: wheel for wheel in wheels}.values())
        with zipfile.ZipFile(out, "w") as archive:  # wheels are compressed already
            archive.writestr("blender_manifest.toml", manifest(wheels, platforms, python))
            archive.writestr("__init__.py", ENTRY)
            for wheel in wheels:
                archive.write(wheel, f"wheels/{wheel.name}")
    return out


def download(folder: Path, platform: str, python: str) -> list[Path]:
    """The wheels that are needed beside this project's, without Blender's own."""
    limits, _ = PYTHONS[python]
    tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "download"]
    options = ["--only-binary", ":all:", "--python-version", python, "--implementation", "cp"]
    command = [*pip, *options, *tags, "--dest", str(folder), *NEEDED, *limits]
    if (done := subprocess.run(command, capture_output=True, encoding="utf-8")).returncode:
        raise OSError(f"wheels cannot be had: {done.stderr.strip().splitlines()[-1:]}")
    return [path for path in folder.glob("*.whl") if not path.name.startswith(f"{BLENDERS_OWN}-")]


def manifest(wheels: list[Path], platforms: list[str], python: str) -> str:
    """The template with what it leaves open, which stands before its first table."""
    _, blenders = PYTHONS[python]
    head, bracket, tables = MANIFEST.read_text(encoding="utf-8").partition("\n[")
    lines = [f'version = "{__version__}"']
    lines += [f'blender_version_{end} = "{version}"' for end, version in blenders.items()]
    lines.append(f"platforms = {_listed(platforms)}")
    lines.append(f"wheels = {_listed([f'./wheels/{wheel.name}' for wheel in wheels])}")
    return head + "\n".join(lines) + "\n" + bracket + tables


def _listed(words: list[str]) -> str:
    return "[" + ", ".join(f'"{word}"' for word in words) + "]"


if __name__ == "__main__":
    raise SystemExit(main())
