"""The page's reader of skeletons finds in Python's rules what it asks for."""

from __future__ import annotations

import json
import re

from bridge.motion import rest_poses, skeletons
from dsnet.view.scene import BUNDLE
from dsnet.view.skeleton_rules import skeleton_rules

RULES = json.loads(skeleton_rules())


def test_a_rule_is_the_constant_of_its_module():
    assert RULES["skeletons"]["OWN_NAMES"] == list(skeletons.OWN_NAMES)
    assert RULES["rest_poses"]["BONES"].keys() == rest_poses._BONES.keys()
    assert len(RULES["mean_joints"]) == len(skeletons.OWN_NAMES)


def test_what_the_page_asks_for_is_there():
    asked = set[str]()
    for path in (BUNDLE.parent / "web").glob("*.js"):
        source = path.read_text(encoding="utf-8")
        asked |= {*re.findall(r"rules(?:\.bvh)?\.([A-Z_]+)", source)}
        for names in re.findall(r"{ ([A-Z_]+(?:, [A-Z_]+)+) }[,)]", source):
            asked |= {*names.split(", ")}
    known = {name for rules in RULES.values() if isinstance(rules, dict) for name in rules}
    assert len(asked) > 40
    assert asked <= known
