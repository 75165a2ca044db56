"""Who computes: each engine is a module, run once for all of its cases."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from bridge.processes import outcome_of_module
from bridge.verify.checks import REFERENCE
from bridge.verify.protocol import ANSWER

ENGINES = {
    REFERENCE: "bridge.verify.reference.engine",
    "torch": "torch_align_ae.verify_engine",
    "keras": "tf_dsnet.verify_engine",
    "onnx": "bridge.verify.onnx_engine",
    "stream": "bridge.verify.streaming_engine",
}


@dataclass(frozen=True)
class Answer:
    """What an engine said; its arrays lie in `folder`, one file a case."""

    folder: Path
    """Where `<case>.safetensors` are."""
    versions: Mapping[str, str]
    """Of the packages that computed."""
    seconds: Mapping[str, float]
    """By case."""
    errors: Mapping[str, str]
    """By case: why there is no file."""
    order: Mapping[str, list[str]]
    """By case that has a result: names of its arrays, first computed first."""
    failure: str = ""
    """Why the process as a whole gave nothing, in one line."""

    def why_missing(self, case: str) -> str:
        """Why there is no result for a case."""
        return self.errors.get(case) or self.failure or "the engine left this case out"


def ask(engine: str, request: Path, out: Path) -> Answer:
    """Run one engine on a request; an engine that dies is an answer too."""
    out.mkdir(parents=True)
    options = ["--request", str(request), "--out", str(out), "--engine", engine]
    status, said = outcome_of_module(ENGINES[engine], *options)
    answer = out / ANSWER
    if status or not answer.is_file():
        last = (said.strip().splitlines() or ["and said nothing"])[-1]
        return Answer(out, {}, {}, {}, {}, f"the process ended with {status}: {last}")
    return Answer(out, **json.loads(answer.read_text(encoding="utf-8")))


Ask = Callable[[str, Path, Path], Answer]
