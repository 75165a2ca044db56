"""Take it into your tools: a point cache of the motion, and one graph for any other motion.

python examples/06_export.py [OUT]

`dsnet export --to usd`, `obj`, `gif` and others do the same from the command line: docs/export.md.
"""

import sys
from pathlib import Path

from bridge.processes import exit_with_one_line
from dsnet.exporters.stage_export import ExportConfig, main

out = Path(sys.argv[1] if len(sys.argv) > 1 else "exported")
with exit_with_one_line():  # what exists is never overwritten: one line says so
    main(ExportConfig(to="pc2", motion=Path("sample:walking"), out=out / "walking"))
    main(ExportConfig(to="onnx", out=out / "body.onnx"))
for path in sorted(out.rglob("*.*")):
    print(f"{path.relative_to(out)}: {path.stat().st_size / 1e6:.1f} MB")
