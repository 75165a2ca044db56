"""What a trained run does for a user: prediction, streaming, ONNX graphs; no framework."""
