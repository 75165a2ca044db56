"""Parity of NumPy, PyTorch, Keras and ONNX: a slow float64 reference and what compares with it."""
