"""The preview of a mosaic, as an ONNX graph. README.md in the folder above explains it."""
