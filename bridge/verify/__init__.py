"""Parity of PyTorch, Keras, ONNX and streaming with a slow float64 reference in NumPy."""
