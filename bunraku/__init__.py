"""Make any unrigged 3D figure move."""

__version__ = "0.1.0"
