"""The command ``jaxmodel calibrate``."""
