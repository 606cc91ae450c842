"""The version of mpvi_bt."""

__version__ = "0.1.0"
