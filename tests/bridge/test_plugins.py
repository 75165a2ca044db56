"""Modules that add to the product: named by the user's environment, and by nothing else."""

from __future__ import annotations

import pytest

from bridge import DsnetError
from bridge.plugins import entry_named, with_plugins
from dsnet import cli
from tests.forged.plugin import use_plugin

OWN = {"own": 1}


def test_several_add_what_they_have(tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "er.py").write_text("def tissues():\n    return {'a': 2}\n")
    name = use_plugin(tmp_path, monkeypatch, "def mesh_forms():\n    return {'b': 3}\n")
    monkeypatch.setenv("DSNET_PLUGINS", f" {name}  deep.er ")
    assert with_plugins("tissues", OWN) == {"own": 1, "a": 2}
    assert with_plugins("mesh_forms", {}) == {"b": 3}


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import not_there_at_all", "No module named 'not_there_at_all'"),
        ("def tissues(:", "SyntaxError"),
        ("def tissues():\n    return 1 / 0\n", "ZeroDivisionError"),
        ("tissues = None", "TypeError"),
        ("def tissues():\n    return {'own': 2}\n", "own anew"),
    ],
)
def test_one_that_is_no_good_is_one_line(tmp_path, monkeypatch, capsys, source, said):
    name = use_plugin(tmp_path, monkeypatch, source)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["corpus", "--profile", "smoke", "--run", "r"])
    printed = capsys.readouterr().err
    assert (stopped.value.code, printed.count("\n")) == (2, 1)
    assert f"DSNET_PLUGINS with {name}" in printed
    assert said in printed


def test_an_unknown_name_is_told_where_names_come_from():
    assert entry_named("own", "--tissue", OWN) == 1
    with pytest.raises(DsnetError, match=r"--tissue other; expected one of own\..*DSNET_PLUGINS"):
        entry_named("other", "--tissue", OWN)
