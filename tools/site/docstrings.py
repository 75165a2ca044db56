"""How the site reads docstrings: numpydoc's sections in the form that this tree writes them."""

from __future__ import annotations

import re
from textwrap import indent
from typing import Any

import griffe

_ITEM = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*) : (.+)", re.M)
_RETURNED = re.compile(r"^((?:Returns|Yields)\n-+\n)((?:\S.*(?:\n|\Z))+)(?=\n|\Z)", re.M)


class ProseSections(griffe.Extension):
    """Reads `name : what it is` and prose under `Returns`; types come from the annotations."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Move prose from where numpydoc has a type to where it has a description."""
        if obj.docstring:
            items = _ITEM.sub(r"\1\n    \2", obj.docstring.value)
            obj.docstring.value = _RETURNED.sub(lambda m: f"{m[1]}:\n{indent(m[2], '    ')}", items)


class ReExports(griffe.Extension):
    """A package's page names what it hands on; the page of the defining module describes it."""

    def on_module(self, *, mod: griffe.Module, **_: Any) -> None:
        """List what a package imports from others of the tree for its users."""
        names = [str(name) for name in mod.exports or () if mod.is_init_module]
        exported = [mod.members.get(name) for name in names if not name.startswith("_")]
        handed_on = [member for member in exported if isinstance(member, griffe.Alias)]
        for member in handed_on:
            member.public = False
        if handed_on and mod.docstring:
            names = ", ".join(f"[`{one.name}`][{mod.path}.{one.name}]" for one in handed_on)
            mod.docstring.value += f"\n\nTo be imported from here: {names}."
