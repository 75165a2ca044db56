"""FBX of Mixamo, Rokoko, Unreal, Maya, Blender: the longest take, of the joints of one person.

At rest the joints lie as the file's skin or bind pose has them, or else as its bones stand without
animation. Another process reads the file (`bridge.motion.readers.fbx_process` says why).
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import cast

from bridge.errors import DsnetError
from bridge.installation import require_package
from bridge.motion.motion import AS_IT_SAYS, HowRead, Motion, UpAxis
from bridge.motion.readers.nodes import NodeTree, Person, followed, moving
from bridge.motion.skeletons import SkeletonMotion, unusable
from bridge.processes import outcome_of_module
from bridge.runs.untrusted import file_refused, open_npz, open_regular

_MOST_BYTES = 1 << 30
_PROCESS = "bridge.motion.readers.fbx_process"


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read one file; its vertical is what the file states, unless the user says otherwise."""
    require_package("ufbx", "fbx", "reading FBX")
    with file_refused(path, unusable, "Export it again, as FBX 7.4 binary, or as GLB."):
        open_regular(path, _MOST_BYTES).close()
        skeleton, person, up = _by_process(path, how)
    return followed(skeleton, person, how, up)


def _by_process(path: Path, how: HowRead) -> tuple[SkeletonMotion, Person, UpAxis | None]:
    with tempfile.TemporaryDirectory(prefix="fbx_") as folder:
        out = Path(folder) / "motion.npz"
        status, printed = outcome_of_module(
            _PROCESS, str(path), json.dumps(dict(how.joint_map)), str(out)
        )
        if status:
            why = printed.strip().splitlines()[-1:] or ["nothing said"]
            raise ValueError(f"its reader ended with {status}: {why[0]}")
        with open_npz(out) as arrays:
            found = {name: arrays.array(name) for name in arrays}
    if "refused" in found:
        raise DsnetError(*map(str, found["refused"]))
    if "damaged" in found:
        raise ValueError(str(found["damaged"]))
    tree = NodeTree(path, tuple(found["names"].tolist()), tuple(found["parents"].tolist()), (),
                    found["rest"], "")  # fmt: skip
    joint_map = json.loads(str(found["joint_map"]))
    person = Person(tuple(found["nodes"].tolist()), joint_map, tuple(found["notes"].tolist()))
    skeleton = moving(tree, person, found["world"], float(found["fps"]), ())
    return skeleton, person, cast(UpAxis, str(found["up"])) or None
