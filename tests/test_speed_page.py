"""Tables of the deployable graphs: the larger limit is named, and absent peers have no row."""

from __future__ import annotations

from tools.speed_page import PARTS, WHOLE, peers_block, precision_block, runtime_block


def shares(ms: float, **others: float) -> dict[str, float]:
    return {"times_moving": 9.0, "times_multiplying": 2.5, "ms": ms, **others}


def test_a_cell_names_the_limit_that_is_nearer():
    moved = {"must_move_mb": 20.0, "operations_move_mb": 300.0}
    one = {part: shares(4.0, **moved) | {"times_moving": 1.5} for part in PARTS}
    many = {part: shares(40.0, **moved) for part in PARTS}
    rates = {"frames_per_s": dict.fromkeys(WHOLE, 250.0)}
    bench = {"machine": "M", "cores": 2, "characters_1": {**one, **rates}}
    bench["characters_64"] = {**many, **rates, "read_gb_per_s": 10.0}
    found = runtime_block(bench)
    assert "| part | 1 character | 64 characters |" in found
    assert "| the paper's decoder | 1.5 moving, 4.0 ms | 2.5 products, 40.0 ms |" in found
    assert "| `dsnet_plus`, int8 | 250 | 250 |" in found
    assert "| the paper's decoder | 20 | 300 | 30.0 ms | 40.0 ms |" in found


def test_peers_that_are_there_have_a_row_each():
    groups = {"onnx": shares(2.0, times_ours=1.0), "smplx": shares(5.0, times_ours=2.5)}
    decoders = {"paper_onnx": shares(1.0, times_ours=1.0)}
    bench = {"machine": "M", "threads": 2, "versions": {"smplx": "0.1.28"}}
    found = peers_block({**bench, "posing": {"1": groups}, "decoding": {"16": decoders}})
    assert "smplx 0.1.28" in found
    assert "| from a pose to posed vertices | 1 body |" in found
    assert "| smplx, PyTorch | 2.5, 5.0 ms |" in found
    assert "| the paper's decoder, ONNX Runtime | 1.0, 1.0 ms |" in found
    assert "smplfitter" not in found
    assert peers_block(None) == "Not measured.\n"


def test_both_precisions_stand_in_a_row():
    r2 = {
        "float32": {"validation": 0.95671, "held_out": 0.94},
        "bfloat16": {"validation": 0.95652, "held_out": 0.9398},
    }
    code = {"steps": 120, "step_to_float32": 0.494, "r2": r2}
    bench = {"machine": "M", "threads": 1, "seed": 0, "codes": {"casas_otaduy": code}}
    found = precision_block(bench)
    assert "on M, 1 thread, seed 0:" in found
    assert "| Casas-Otaduy's network | 0.49 | 120 | 0.9567, 0.9565 | 0.9400, 0.9398 |" in found
