"""ONNX graphs of predictors and bodies."""
