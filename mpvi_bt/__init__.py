"""A behavior-tree executive for long-horizon mobile manipulation."""

__version__ = "0.1.0"
