"""`python -m benchmarks.subspaces --out DIR --run RUN`: see `benchmarks.subspaces.comparison`."""

from __future__ import annotations

from benchmarks.processes import run_as_process
from benchmarks.subspaces.comparison import SubspacesConfig, main

if __name__ == "__main__":
    run_as_process(SubspacesConfig, main)
