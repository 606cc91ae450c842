"""The robot where none is chosen; loads nothing, as `mpvi --help` needs it."""

DEFAULT_ROBOT = "r1"
