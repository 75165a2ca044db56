"""What modules outside of the product add to it: predictors, laws of tissue, forms of meshes.

The environment variable `DSNET_PLUGINS` names modules that can be imported, with spaces between
them. Each has any of the functions

    predictors()    name -> `tf_dsnet.predictors.Predictor`
    tissues()       name -> `dsnet.synthetic.tissue_laws.TissueLaw`
    mesh_forms()    name -> `dsnet.synthetic.tissue_laws.MakeForm`

that return what it adds. They import inside, so that no process loads both frameworks. Only the
user's environment names a module: files of a run hold plain names, and nothing is imported because
a file says so.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from typing import TypeVar

from bridge.errors import DsnetError, unknown_name

VARIABLE = "DSNET_PLUGINS"
Entry = TypeVar("Entry")


def with_plugins(kind: str, built_in: Mapping[str, Entry]) -> dict[str, Entry]:
    """The entries of the product by name, then those of the function `kind` of plugins."""
    entries = dict(built_in)
    for module in os.environ.get(VARIABLE, "").split():
        try:
            added = dict(getattr(importlib.import_module(module), kind, dict)())
        except Exception as error:  # a plugin can fail in any way
            raise DsnetError(
                f"{VARIABLE} with {module}: {type(error).__name__}: {error}",
                "modules that can be imported",
                f"Correct {VARIABLE}, or set PYTHONPATH to the folder that holds the module.",
            ) from error
        if taken := entries.keys() & added.keys():
            raise DsnetError(
                f"{VARIABLE} with {module}, which registers {', '.join(sorted(taken))} anew",
                "names that are not taken",
                f"Rename what it registers, or leave it out of {VARIABLE}.",
            )
        entries |= added
    return entries


def entry_named(name: str, flag: str, entries: Mapping[str, Entry]) -> Entry:
    """The entry of a name that was given as an option, or that a file holds."""
    if name not in entries:
        remedy = f"Name one of these, or in {VARIABLE} the module that registers {name}."
        raise unknown_name(f"{flag} {name}", name, entries, remedy)
    return entries[name]
