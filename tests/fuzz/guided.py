"""Inputs by coverage: atheris draws what the strategies draw, and keeps what takes new branches."""

from __future__ import annotations

import json
import os
import random
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

# Not among the requirements: it comes for few systems.
atheris: Any = import_module("atheris")


def guide(
    test: Callable[..., Any], inputs: int, seed: int, folder: Path, summary: Callable[[], dict]
) -> None:
    """Try `inputs` inputs on a test that hypothesis made; print its summary and end the process.

    What the library itself instruments is the readers' Python; those in C are driven by it.
    """
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    rng = random.Random(seed)
    for number in range(20):
        (corpus / f"seed-{number}").write_bytes(rng.randbytes(4096))
    instrument()
    take = test.hypothesis.fuzz_one_input  # pyright: ignore[reportFunctionMemberAccess]
    done = 0

    def once(data: bytes) -> None:
        nonlocal done
        take(data)
        done += 1
        if done >= inputs:
            # libFuzzer ends a process without unwinding it.
            sys.stdout.write(json.dumps(summary()) + "\n")
            sys.stdout.flush()
            os._exit(0)

    arguments = [f"-seed={seed + 1}", "-max_len=16384", "-rss_limit_mb=4096", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *arguments, str(corpus)], once)
    atheris.Fuzz()


def instrument() -> None:
    """Count the branches of the readers' own functions."""
    for name, module in list(sys.modules.items()):
        if not name.startswith(("bridge.", "dsnet.synthetic")):
            continue
        own = [v for v in vars(module).values() if getattr(v, "__module__", None) == name]
        for function in own:
            if hasattr(function, "__code__"):
                setattr(module, function.__name__, atheris.instrument_func(function))
