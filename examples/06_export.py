"""Export to other tools: a motion as a point cache, and the predictor as an ONNX graph.

python examples/06_export.py [OUT]

`dsnet export` does the same from the command line; docs/export.md has all formats. Existing files
are never overwritten.
"""

import sys
from pathlib import Path

import dsnet

out = Path(sys.argv[1] if len(sys.argv) > 1 else "exported")
dsnet.export("sample:walking", out / "walking", to="pc2")
dsnet.export(None, out / "body.onnx")
for path in sorted(out.rglob("*.*")):
    print(f"{path.relative_to(out)}: {path.stat().st_size / 1e6:.1f} MB")
