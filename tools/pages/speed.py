"""docs/results/demo/speed.md: training, the deployable graphs, their limits and their peers."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from bridge.runs import Run
from tools.pages.blocks import RESULTS, folder_of, load, table

PARTS = {
    "load": "`dsnet_plus`: load on its nodes",
    "step": "`dsnet_plus`: step of its oscillators",
    "spread": "`dsnet_plus`: from nodes to vertices",
    "decoder": "the paper's decoder",
    "skinning": "pose blend shapes and skinning",
    "dsnet_plus": "pose to posed mesh, `dsnet_plus`",
    "dsnet_plus_int8": "the same, int8",
    "dsnet": "pose to posed mesh, DSNet and decoder",
    "dsnet_int8": "the same, int8",
}
WHOLE = {
    "dsnet_plus": "`dsnet_plus`",
    "dsnet_plus_int8": "`dsnet_plus`, int8",
    "dsnet": "DSNet and decoder",
    "dsnet_int8": "DSNet and decoder, int8",
}
POSING = {
    "onnx": "the graph",
    "torch": "`torch_align_ae.SMPL`, PyTorch",
    "smplx": "smplx, PyTorch",
    "smplfitter_torch": "smplfitter, PyTorch",
    "smplfitter_torchscript": "smplfitter, TorchScript",
    "smplfitter_numba": "smplfitter, Numba",
}
DECODING = {
    "paper_onnx": "the paper's decoder, ONNX Runtime",
    "paper_torch": "the same, PyTorch",
    "casas_otaduy_onnx": "Casas-Otaduy's decoder, ONNX Runtime",
    "casas_otaduy_torch": "the same, PyTorch",
}
CODES = {
    "mesh_measured": "the mesh autoencoder, preset `measured`",
    "mesh_literal": "the same, preset `literal`",
    "casas_otaduy": "Casas-Otaduy's network",
}
_HEAD = """# Speed

How long training, prediction and posing take. Measure your machine:

```
python -m benchmarks.speed --run demo             # some minutes, 7 GB of memory
python -m tools.update_pages speed --run demo     # writes this page
```

`smplx` and `smplfitter` are compared where they are installed (extra `dev`). On a machine with
other work, `--clock processor` of `python -m benchmarks.speed.runtime` and `python -m
benchmarks.speed.peers` counts one thread's own time. What a whole run costs stands in its report:
[`demo`](report.md#how-it-was-made), [`paper`](../paper/report.md#how-it-was-made); what
[pictures and clips](../pictures.json) cost was measured once.
"""
_PRECISION = """With `dsnet train-ae --precision bfloat16` (the default where the processor has
`avx512_bf16`, but for the literal presets) matrices are multiplied in bfloat16 and added in
float32; weights, Adam's moments and scores stay float32. `python -m benchmarks.speed.precision`
trains in both.
"""
_LIMITS = """A part cannot be faster than the larger of two limits, which are measured in the same
run. *Moving*: its weights and inputs are read once and its outputs written once, at the rate at
which a large array is read. *Products*: its matrix products run at the rate of a large square one.
`dsnet_plus` moves many times what it must, because ONNX Runtime makes a pass over the arrays for
each of its many small operations; the paper's decoder is hardly more than matrix products.
"""
_BESIDE = """The same bodies and poses, float32, all cores, warm, without gradients, in turns in one
process; all must give the same vertices first. The paper's autoencoder has far fewer parameters
than Casas-Otaduy's but about as much arithmetic, since its weights are applied to nine features of
every vertex: it saves memory and the optimiser's work.
"""
Cells = Mapping[str, Any]


def take_bench(run: Run) -> None:
    """Copy what `python -m benchmarks.speed` measured of a run."""
    source, target = folder_of(run, "bench"), RESULTS / run.path.name / "bench"
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(source, target)


def page() -> str:
    """All that `python -m benchmarks.speed` measured."""
    files = sorted((RESULTS / "demo" / "bench").glob("*.json"))
    bench = {path.stem: load(f"demo/bench/{path.stem}") for path in files}
    return (
        f"{_HEAD}\n"
        f"## Training, and DSNet alone\n\n{_training(bench['torch'], bench['tensorflow'])}\n"
        f"{_PRECISION}\n{_precision(bench.get('precision'))}\n"
        f"## From a pose to the posed skin\n\n{_LIMITS}\n{_runtime(bench['runtime'])}\n"
        f"## Beside others\n\n{_BESIDE}\n{_peers(bench.get('peers'))}"
    )


def _training(torch: Cells, tensorflow: Cells) -> str:
    """Training steps beside a peer and the machine's limit; DSNet's epoch and streaming step."""
    step_s, gflops, frame_us = torch["median_s"], torch["gflops"], tensorflow["step_us"]
    rows = {
        "autoencoder, one training step of 64 meshes": f"{step_s['mesh_autoencoder']:.2f} s",
        "the same of Casas-Otaduy's network": f"{step_s['casas_otaduy']:.2f} s",
        "ratio of the two, Adam fused on both sides": f"{torch['mesh_to_casas_otaduy']:.2f}",
        "ratio of the two, PyTorch's default Adam on both sides":
            f"{torch['mesh_to_casas_otaduy_plain_adam']:.2f}",
        "arithmetic rate of the autoencoder's step, of a plain matrix product":
            f"{gflops['mesh_autoencoder']:.0f}, {gflops['gemm']:.0f} GFLOP/s",
        "DSNet, one epoch of 67 x 300 frames": f"{tensorflow['epoch_s']:.2f} s",
        "the same with Keras's own LSTM": f"{tensorflow['epoch_keras_lstm_s']:.2f} s",
        "DSNet, one streamed frame of 1 character": f"{frame_us['1']:.0f} µs",
        "DSNet, one streamed frame of 16 characters": f"{frame_us['16']:.0f} µs",
    }  # fmt: skip
    shown = table("what | measured", rows.items())
    return f"Medians on {torch['machine']}, {torch['threads']} threads.\n\n{shown}"


def _precision(bench: Cells | None) -> str:
    """Codes trained by bfloat16 products beside the same in float32, where they were trained."""
    if bench is None:
        return "In bfloat16: not measured.\n"
    rows = []
    for name, code in bench["codes"].items():
        exact, rounded = (code["r2"][one] for one in ("float32", "bfloat16"))
        both = [f"{exact[frames]:.4f}, {rounded[frames]:.4f}" for frames in exact]
        rows.append([CODES[name], f"{code['step_to_float32']:.2f}", code["steps"], *both])
    head = "float32, bfloat16 products | ratio of a step's time | steps | R² of validation"
    threads = _counted(bench["threads"], "thread")
    return (
        f"Trained in both precisions, on {bench['machine']}, {threads}, seed {bench['seed']}:\n\n"
        f"{table(f'{head} | R² held out', rows)}"
    )


def _runtime(bench: Cells) -> str:
    """From a pose to the posed skin in ONNX Runtime, beside the machine's limits."""
    counts = {
        _counted(key.removeprefix("characters_"), "character"): found
        for key, found in bench.items()
        if key.startswith("characters_")
    }
    rates = {count: found["frames_per_s"] for count, found in counts.items()}
    most, found = list(counts.items())[-1]
    moved = [[title, *_moved(found[part], found)] for part, title in PARTS.items()]
    head = "part | must be moved | its operations move | that, from memory | measured"
    return (
        f"Medians on {bench['machine']}, {bench['cores']} cores, one frame of all characters; each "
        "cell: times as long as\nits limit, which limit that is, ms.\n\n"
        + _by_count("part", PARTS, counts, limit_and_ms)
        + "\n"
        + _by_count("frames a second, from pose to posed mesh", WHOLE, rates, "{:.0f}".format)
        + f"\nFor {most}, in one frame, MB; memory was read at "
        f"{found['read_gb_per_s']:.0f} GB/s:\n\n{table(head, moved)}"
    )


def _moved(part: Cells, found: Cells) -> Iterable[str]:
    """MB that must be moved and that operations move, and ms of these and in all."""
    moved_mb = part["operations_move_mb"]
    yield from (f"{part['must_move_mb']:.0f}", f"{moved_mb:.0f}")
    yield from (f"{moved_mb / found['read_gb_per_s']:.1f} ms", f"{part['ms']:.1f} ms")


def _peers(bench: Cells | None) -> str:
    """Posing and decoding beside peers, where they were measured; absent ones have no row."""
    if bench is None:
        return "Not measured.\n"
    versions = ", ".join(f"{name} {version}" for name, version in bench["versions"].items())
    posing, decoding = (
        {_counted(count, "body", "bodies"): found for count, found in bench[what].items()}
        for what in ("posing", "decoding")
    )
    return (
        f"Medians on {bench['machine']}, {bench['threads']} threads; {versions}. Each cell: times "
        "as long as the first row, ms.\n\n"
        + _by_count("from a pose to posed vertices", _in(POSING, posing), posing, _times_and_ms)
        + "\n"
        + _by_count("from latents to offsets", _in(DECODING, decoding), decoding, _times_and_ms)
    )


def _in(names: Cells, counts: Cells) -> Cells:
    """Those names that were measured for every count."""
    return {
        key: name for key, name in names.items() if all(key in found for found in counts.values())
    }


def _by_count(title: str, names: Cells, counts: Cells, cell: Callable[[Any], str]) -> str:
    """A table with a column for each count."""
    rows = [[name, *(cell(found[key]) for found in counts.values())] for key, name in names.items()]
    return table(" | ".join([title, *counts]), rows)


def limit_and_ms(part: Cells) -> str:
    """The larger limit is the one that a part comes nearer to."""
    times, limit = min((part["times_moving"], "moving"), (part["times_multiplying"], "products"))
    return f"{times:.1f} {limit}, {part['ms']:.1f} ms"


def _times_and_ms(peer: Cells) -> str:
    return f"{peer['times_ours']:.1f}, {peer['ms']:.1f} ms"


def _counted(count: object, one: str, many: str = "") -> str:
    return f"{count} {one if str(count) == '1' else many or one + 's'}"
