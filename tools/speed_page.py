"""docs/results/demo/speed.md: training, the deployable graphs, their limits and their peers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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
Shares = dict[str, float]


def speed_page(bench: dict[str, Any]) -> str:
    """Everything that `python -m benchmarks.speed` measured, as Markdown."""
    return (
        "# Speed: measured\n\nWritten by `python -m benchmarks.speed` and `python -m "
        "tools.update_readme`; [what it means](../../performance.md).\n\n"
        f"## Training, and DSNet alone\n\n{_training(bench)}\n"
        f"## From a pose to the posed skin\n\n{runtime_block(bench['runtime'])}\n"
        f"## Beside others\n\n{peers_block(bench.get('peers'))}"
    )


def _training(bench: dict[str, Any]) -> str:
    """Training steps beside a peer and the machine's limit; DSNet's epoch and streaming step."""
    torch, tensorflow = bench["torch"], bench["tensorflow"]
    median, gflops = torch["median_s"], torch["gflops"]
    rows = [
        ("autoencoder, one training step of 64 meshes", f"{median['mesh_autoencoder']:.2f} s"),
        ("the same of Casas-Otaduy's network", f"{median['casas_otaduy']:.2f} s"),
        ("ratio of the two, Adam fused on both sides", f"{torch['mesh_to_casas_otaduy']:.2f}"),
        (
            "ratio of the two, PyTorch's default Adam on both sides",
            f"{torch['mesh_to_casas_otaduy_plain_adam']:.2f}",
        ),
        (
            "arithmetic rate of the autoencoder's step, of a plain matrix product",
            f"{gflops['mesh_autoencoder']:.0f}, {gflops['gemm']:.0f} GFLOP/s",
        ),
        ("DSNet, one epoch of 67 x 300 frames", f"{tensorflow['epoch_s']:.2f} s"),
        ("the same with Keras's own LSTM", f"{tensorflow['epoch_keras_lstm_s']:.2f} s"),
        ("DSNet, one streamed frame of 1 character", f"{tensorflow['step_us']['1']:.0f} µs"),
        ("DSNet, one streamed frame of 16 characters", f"{tensorflow['step_us']['16']:.0f} µs"),
    ]
    table = _table(["what", "measured"], rows)
    table = f"Medians on {torch['machine']}, {torch['threads']} threads.\n\n{table}"
    return table + (f"\n{precision_block(bench['precision'])}" if "precision" in bench else "")


def precision_block(bench: dict[str, Any]) -> str:
    """Codes trained by bfloat16 products beside the same in float32."""
    rows = []
    for name, code in bench["codes"].items():
        exact, rounded = (code["r2"][one] for one in ("float32", "bfloat16"))
        both = [f"{exact[frames]:.4f}, {rounded[frames]:.4f}" for frames in exact]
        rows.append([CODES[name], f"{code['step_to_float32']:.2f}", str(code["steps"]), *both])
    titles = ["float32, bfloat16 products", "ratio of a step's time", "steps", "R² of validation"]
    threads = _counted(str(bench["threads"]), "thread")
    return (
        f"Trained in both precisions, on {bench['machine']}, {threads}, seed {bench['seed']}:\n\n"
        f"{_table([*titles, 'R² held out'], rows)}"
    )


def runtime_block(bench: dict[str, Any]) -> str:
    """From a pose to the posed skin in ONNX Runtime, beside the machine's limits."""
    measured = {
        key.removeprefix("characters_"): found
        for key, found in bench.items()
        if key.startswith("characters_")
    }
    titles = [_counted(count, "character") for count in measured]
    rows = [
        [title, *(_limit_and_ms(found[part]) for found in measured.values())]
        for part, title in PARTS.items()
    ]
    most, found = list(measured.items())[-1]
    return (
        f"Medians on {bench['machine']}, {bench['cores']} cores, one frame of all characters; each "
        "cell: times as long as\nits limit, which limit that is, ms.\n\n"
        f"{_table(['part', *titles], rows)}\n"
        f"{_frame_rates(measured)}\n"
        f"For {_counted(most, 'character')}, in one frame, MB; memory was read at "
        f"{found['read_gb_per_s']:.0f} GB/s:\n\n{_moved(found)}"
    )


def _frame_rates(measured: dict[str, Any]) -> str:
    """From pose to posed mesh, frames of all characters in a second."""
    counts = [_counted(count, "character") for count in measured]
    rows = [
        [WHOLE[name], *(f"{found['frames_per_s'][name]:.0f}" for found in measured.values())]
        for name in WHOLE
    ]
    return _table(["frames a second, from pose to posed mesh", *counts], rows)


def peers_block(bench: dict[str, Any] | None) -> str:
    """Posing and decoding beside peers, where they were measured."""
    if bench is None:
        return "Not measured.\n"
    versions = ", ".join(f"{name} {version}" for name, version in bench["versions"].items())
    tables = [
        _peers(bench["posing"], POSING, "from a pose to posed vertices", "body", "bodies"),
        _peers(bench["decoding"], DECODING, "from latents to offsets", "body", "bodies"),
    ]
    return (
        f"Medians on {bench['machine']}, {bench['threads']} threads; {versions}. Each cell: times "
        "as long as the first row, ms.\n\n" + "\n".join(tables)
    )


def _peers(
    groups: dict[str, dict[str, Shares]], names: dict[str, str], title: str, one: str, many: str
) -> str:
    titles = [_counted(count, one, many) for count in groups]
    present = [name for name in names if all(name in group for group in groups.values())]
    rows = [
        [names[name], *(_times_and_ms(group[name]) for group in groups.values())]
        for name in present
    ]
    return _table([title, *titles], rows)


def _moved(found: dict[str, Any]) -> str:
    """What must be moved, and what operations move, part by part."""
    rows = []
    for part, title in PARTS.items():
        shares = found[part]
        moved_mb = shares["operations_move_mb"]
        rows.append(
            [
                title,
                f"{shares['must_move_mb']:.0f}",
                f"{moved_mb:.0f}",
                f"{moved_mb / found['read_gb_per_s']:.1f} ms",
                f"{shares['ms']:.1f} ms",
            ]
        )
    head = ["part", "must be moved", "its operations move", "that, from memory", "measured"]
    return _table(head, rows)


def _limit_and_ms(shares: Shares) -> str:
    """The larger limit is the one that a part comes nearer to."""
    limits = {"moving": shares["times_moving"], "products": shares["times_multiplying"]}
    nearest = min(limits, key=limits.__getitem__)
    return f"{limits[nearest]:.1f} {nearest}, {shares['ms']:.1f} ms"


def _times_and_ms(shares: Shares) -> str:
    return f"{shares['times_ours']:.1f}, {shares['ms']:.1f} ms"


def _counted(count: str, one: str, many: str = "") -> str:
    return f"{count} {one if count == '1' else many or one + 's'}"


def _table(head: list[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---", *("---:" for _ in head[1:])], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
