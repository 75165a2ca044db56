"""Networks, tissue and bodies as ONNX graphs, written straight from named arrays."""
