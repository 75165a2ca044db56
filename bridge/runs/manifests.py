"""Whether a manifest says what every reader of it relies on; its digest can be anybody's."""

from __future__ import annotations

from collections.abc import Mapping
from types import NoneType
from typing import Any

import numpy as np

from bridge.runs.foreign_files import is_plain_name

_TEXTS = ("kind", "data", "sha256")
_OBJECTS = ("arrays", "files", "upstream", "config", "provenance")


def flaw_of_manifest(manifest: Mapping[str, Any]) -> str | None:
    """What is wrong with a manifest that has all of its keys, as the end of a sentence.

    None where nothing is: names stay in the folder, arrays are of numbers, digests are text.
    """
    for key in (*_TEXTS, *_OBJECTS):
        wanted = str if key in _TEXTS else dict
        if not isinstance(manifest[key], wanted):
            return f"whose {key!r} is a {type(manifest[key]).__name__}"
    if manifest["data"] not in ("synthetic", "licensed"):
        return "whose data are neither synthetic nor licensed"
    inputs = manifest["provenance"].get("inputs", {})
    if not isinstance(manifest["provenance"].get("sha256"), (str, NoneType)):
        return "whose provenance has no digest"
    if not _are_texts(manifest["upstream"]) or not _are_texts(inputs):
        return "whose sources are no digests"
    for group in ("arrays", "files", "upstream"):
        for name, entry in manifest[group].items():
            if not is_plain_name(name):
                return f"with the name {name[:80]!r} in {group}, which is no plain file name"
            if group != "upstream" and not _has_digest(entry):
                return f"whose {name!r} has no digest"
            if group == "arrays" and not _is_array(entry):
                return f"whose array {name!r} has no shape and type of numbers"
    return _flaw_of_lists(manifest)


def _flaw_of_lists(manifest: Mapping[str, Any]) -> str | None:
    """The same of what some stages add: the sequences, and the predictors by name."""
    sequences, predictors = manifest.get("sequences", []), manifest.get("predictors", {})
    if not isinstance(sequences, list) or not all(isinstance(one, dict) for one in sequences):
        return "whose sequences are no list of objects"
    if not isinstance(predictors, dict):
        return "whose predictors have no names"
    if not all(map(is_plain_name, predictors)):
        return "whose predictors are no plain names"
    return None


def _are_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())


def _has_digest(entry: Any) -> bool:
    return isinstance(entry, dict) and isinstance(entry.get("sha256"), str)


def _is_array(entry: Mapping[str, Any]) -> bool:
    shape, dtype = entry.get("shape"), entry.get("dtype")
    if not isinstance(shape, list) or not all(type(size) is int and size >= 0 for size in shape):
        return False
    try:
        return isinstance(dtype, str) and np.dtype(dtype).kind in "biuf"
    except TypeError:
        return False
