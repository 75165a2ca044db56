"""Take it into your tools: a point cache of the motion, and one graph for any other motion.

python examples/06_export.py [OUT]

`dsnet export --to usd`, `obj`, `gif` and others do the same from the command line: docs/export.md.
What exists is never overwritten.
"""

import sys
from pathlib import Path

import dsnet

out = Path(sys.argv[1] if len(sys.argv) > 1 else "exported")
dsnet.export("sample:walking", out / "walking", to="pc2")
dsnet.export(None, out / "body.onnx")
for path in sorted(out.rglob("*.*")):
    print(f"{path.relative_to(out)}: {path.stat().st_size / 1e6:.1f} MB")
