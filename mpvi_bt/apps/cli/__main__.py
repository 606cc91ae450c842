"""`python -m mpvi_bt.apps.cli` is `mpvi`."""

from mpvi_bt.apps.cli import main

main()
