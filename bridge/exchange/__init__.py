"""What crosses between the frameworks besides artifacts: weights, and what DSNet is given."""

from bridge.exchange.weights import load_weights, save_weights

__all__ = ["load_weights", "save_weights"]
