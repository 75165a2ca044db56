"""Times of calls that take turns, beside what no program on this machine undercuts.

Two limits are taken in the same turns as the calls. *Moving*: a call reads its weights and what it
is given once and writes what it gives, at the rate at which a large array is read from memory.
*Multiplying*: its matrix products run at the rate of a large square one.
"""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray

from dsnet.onnx.onnx_graph import Graph, Value

Clock = Literal["wall", "processor"]
_SQUARE = 1024
_WARMING_TURNS = 2
_PAUSE_S = 0.02


@dataclass(frozen=True)
class Limits:
    """What the machine reached while the calls were timed."""

    bytes_per_s: float
    multiplications_per_s: float

    def beside(self, seconds: float, moved_bytes: int, multiplications: int) -> dict[str, float]:
        """How many times as long as each limit a call took, and its milliseconds."""
        return {
            "times_moving": seconds * self.bytes_per_s / moved_bytes,
            "times_multiplying": seconds * self.multiplications_per_s / multiplications,
            "ms": 1e3 * seconds,
        }


class GraphCall:
    """One frame of a graph with random inputs; a state goes on from frame to frame.

    Parameters
    ----------
    model : the graph.
    rng : draws the inputs.
    count : characters.
    threads : of ONNX Runtime.
    profiled : a file that receives what each operation did, or None.
    """

    def __init__(
        self,
        model: onnx.ModelProto,
        rng: np.random.Generator,
        count: int,
        threads: int,
        profiled: Path | None = None,
    ) -> None:
        options = onnxruntime.SessionOptions()
        # Threads that wait for a session's next run would be in the way of the one that is timed.
        options.add_session_config_entry("session.force_spinning_stop", "1")
        options.intra_op_num_threads = threads
        options.log_severity_level = 3  # a part leaves arrays of the whole unused, and is told so
        if profiled is not None:
            options.enable_profiling, options.profile_file_prefix = True, str(profiled)
        self.session = onnxruntime.InferenceSession(
            model.SerializeToString(), options, providers=["CPUExecutionProvider"]
        )
        self.feed: dict[str, NDArray[np.float32]] = {
            given.name: rng.normal(0, 0.01, (count, *given.shape[1:])).astype(np.float32)
            for given in self.session.get_inputs()
        }
        if "state" in self.feed:
            self.feed["state"] = np.zeros_like(self.feed["state"])

    def __call__(self) -> dict[str, NDArray]:
        """Outputs by name."""
        names = [output.name for output in self.session.get_outputs()]
        arrays = map(np.asarray, self.session.run(names, self.feed))
        found = dict(zip(names, arrays, strict=True))
        if "next_state" in found:
            self.feed["state"] = found["next_state"]
        return found

    def given_and_found_bytes(self) -> int:
        """What a frame is given and gives."""
        return sum(array.nbytes for array in (*self.feed.values(), *self().values()))


def operations_bytes(model: onnx.ModelProto, rng: np.random.Generator, count: int) -> int:
    """What the operations of one frame read and write, weights apart, as ONNX Runtime reports it.

    Each operation is a pass of its own over arrays of all characters: with many of them that, and
    not what must be moved, is the memory's and the caches' work.
    """
    with tempfile.TemporaryDirectory() as folder:
        call = GraphCall(model, rng, count, 1, Path(folder) / "profile")
        for _ in range(2):  # in the first frame of all, characters begin
            call()
        events = json.loads(Path(call.session.end_profiling()).read_text(encoding="utf-8"))
    started = max(event["ts"] for event in events if event["name"] == "model_run")
    return sum(
        int(event["args"].get(size, 0))
        for event in events
        if event["ts"] >= started and event["name"].endswith("_kernel_time")
        if event["args"]["op_name"] not in ("If", "Loop", "Scan")  # their operations are counted
        for size in ("activation_size", "output_size")
    )


def _wait() -> None:
    """OpenMP threads of the call before wait busily for some ms. A processor that slept meanwhile
    would need longer for the next call than one in use."""
    until = time.perf_counter() + _PAUSE_S
    while time.perf_counter() < until:
        pass


def measured(
    calls: Mapping[str, Callable[[], Any]],
    largest_bytes: int,
    rounds: int,
    threads: int,
    clock: Clock,
) -> tuple[dict[str, float], Limits]:
    """Median seconds of each call, and the limits.

    Parameters
    ----------
    calls : take turns, so that each finds its weights out of the caches.
    largest_bytes : of the array that is read: as much as the largest of the calls reads.
    rounds : turns that count.
    threads : that read.
    clock : wall time; or the calling thread's own, which is meaningful for one thread only.
    """
    largest = np.ones(max(largest_bytes // 4, 1), np.float32)
    pieces = np.array_split(largest, threads)
    square = GraphCall(_square(), np.random.default_rng(0), _SQUARE, threads)
    now = time.thread_time if clock == "processor" else time.perf_counter
    with ThreadPoolExecutor(threads) as pool:
        read = map if threads == 1 else pool.map
        # A sum would wait for its additions: the largest number is found at twice its rate.
        limits = {"square": square, "read": lambda: list(read(np.maximum.reduce, pieces))}
        medians = _interleaved({**calls, **limits}, rounds, now)
    bytes_per_s = largest.nbytes / medians.pop("read")
    return medians, Limits(bytes_per_s, _SQUARE**3 / medians.pop("square"))


def _interleaved(
    calls: Mapping[str, Callable[[], Any]], rounds: int, now: Callable[[], float]
) -> dict[str, float]:
    """Median seconds of each call, turn by turn, after turns that do not count."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(rounds + _WARMING_TURNS):
        for name, call in calls.items():
            _wait()
            started = now()
            call()
            if turn >= _WARMING_TURNS:
                seconds[name].append(now() - started)
    return {name: statistics.median(values) for name, values in seconds.items()}


def _square() -> onnx.ModelProto:
    """The largest rate of multiplications: a product of two square matrices."""
    graph = Graph()
    found: Value = graph.input("a", ("B", _SQUARE)) @ graph.input("b", ("B", _SQUARE))
    return graph.model("square", {"found": found}, {})
