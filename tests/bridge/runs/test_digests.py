"""The cache of digests: a file is read once, and again whenever it may have changed."""

from __future__ import annotations

import hashlib
import json
import os
import time

import pytest

from bridge.runs import digests
from bridge.runs.digests import cached_sha256, cached_sha256s


@pytest.fixture
def large(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    path = tmp_path / "r" / "stage" / "x.npy"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"a" * 100_000)
    time.sleep(0.1)
    return path


@pytest.fixture
def readings(monkeypatch):
    real, seen = digests.file_sha256, []

    def count(path):
        seen.append(path)
        return real(path)

    monkeypatch.setattr(digests, "file_sha256", count)
    return seen


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_file_is_read_once(large, readings):
    for _ in range(3):
        assert cached_sha256(large) == sha256(large)
    assert len(readings) == 1


def test_a_changed_file_is_read_again_even_with_its_old_time(large, readings):
    cached_sha256(large)
    before = large.stat()
    large.write_bytes(b"a" * 99_999 + b"b")
    os.utime(large, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert cached_sha256(large) == sha256(large)
    assert len(readings) == 2


def test_a_file_that_was_changed_just_now_is_not_trusted(large):
    for content in (b"c" * 100_000, b"d" * 100_000):
        large.write_bytes(content)
        assert cached_sha256(large) == hashlib.sha256(content).hexdigest()


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"files": 3, "sha256": 1}', None])
def test_a_damaged_cache_costs_a_reading(damage, large, readings, tmp_path):
    cached_sha256(large)
    (cache,) = (tmp_path / ".digests").iterdir()
    content = cache.read_bytes()
    found = sha256(large)
    other = found.replace(found[0], "0" if found[0] != "0" else "1").encode()
    cache.write_bytes(content.replace(found.encode(), other) if damage is None else damage)
    assert cached_sha256(large) == found
    assert len(readings) == 2
    assert cache.read_bytes() == content


def test_the_cache_forgets_files_that_are_gone(large, tmp_path):
    cached_sha256(large)
    other = large.with_name("y.npy")
    large.rename(other)
    time.sleep(0.1)
    cached_sha256(other)
    (cache,) = (tmp_path / ".digests").iterdir()
    assert b"y.npy" in cache.read_bytes()
    assert b"x.npy" not in cache.read_bytes()


def test_without_a_folder_for_it_there_is_no_cache(large, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "none"))
    assert cached_sha256(large) == sha256(large)
    assert not (tmp_path / "none").exists()


@pytest.fixture
def many(large, tmp_path):
    paths = [large.with_name(f"{number}.npz") for number in range(30)]
    for path in paths:
        path.write_bytes(path.name.encode() * 20_000)
    time.sleep(0.1)
    return paths


def test_many_files_are_remembered_at_once(many, readings, monkeypatch):
    saved, save = [], digests._save
    monkeypatch.setattr(digests, "_save", lambda *of: (saved.append(of), save(*of)))
    expected = [sha256(path) for path in many]
    for _ in range(2):
        assert cached_sha256s(many) == expected
    assert readings == many
    assert len(saved) == 1


def test_the_cache_is_read_once_for_many_files(many, monkeypatch):
    cached_sha256s(many)
    digests._read.cache_clear()
    read, parse = [], json.loads
    monkeypatch.setattr(json, "loads", lambda text: (read.append(text), parse(text))[1])
    for path in many:
        assert cached_sha256(path) == sha256(path)
    assert len(read) == 1


def test_an_interrupted_list_is_remembered_as_far_as_it_was_read(many, readings, monkeypatch):
    counted = digests.file_sha256
    stop = {"at": many[10]}

    def until(path):
        if path == stop["at"]:
            raise KeyboardInterrupt
        return counted(path)

    monkeypatch.setattr(digests, "file_sha256", until)
    with pytest.raises(KeyboardInterrupt):
        cached_sha256s(many)
    stop.clear()
    stop["at"] = None
    cached_sha256s(many)
    assert readings == many
