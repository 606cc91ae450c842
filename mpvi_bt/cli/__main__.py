"""`python -m mpvi_bt.cli` is `mpvi`."""

from mpvi_bt.cli import main

main()
