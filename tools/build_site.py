"""Build the documentation site from README, `docs/`, the examples and the docstrings.

    python tools/build_site.py [--out build/site]

Needs the extra `docs`. `demo.html` is the viewer with the packaged model, alive. Strict: a dead
link, a page that is in no menu or a docstring that names what is not there ends it with status 1,
and what `--out` held stays. The pages can be opened as files; their search needs a server:
`python -m http.server --directory build/site`.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from dsnet.view.clip_list import open_clip_list
from dsnet.view.page import document
from dsnet.view.scene import Scene

ROOT = Path(__file__).resolve().parents[1]
CONFIGURATION = ROOT / "tools" / "site" / "mkdocs.yml"
SAMPLES = ("jumping_jacks", "dancing", "walk_cycle")
# Every built site has one: what mkdocstrings tells other sites of its names.
_MARK = "objects.inv"


def demo() -> str:
    """The packaged model, alive in a page, on three samples."""
    clip_list = open_clip_list(None, None)
    return document(Scene(replace(clip_list, clips={n: clip_list.clips[n] for n in SAMPLES})))


def main() -> None:
    """Build, and put the whole site in place of an older one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "site", help="folder to write")
    out: Path = parser.parse_args().out.resolve()
    if out.exists() and not (out / _MARK).is_file():
        parser.error(f"{out} exists and is no site: name a new folder, or one that holds a site")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        built = Path(folder) / "site"
        command = ["mkdocs", "build", "--strict", "-f", str(CONFIGURATION), "-d", str(built)]
        status = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, check=False).returncode
        if status:
            sys.exit(status)
        (built / "demo.html").write_text(demo(), encoding="utf-8", newline="\n")
        if out.exists():
            shutil.rmtree(out)
        built.rename(out)
    print(out / "index.html")


if __name__ == "__main__":
    main()
