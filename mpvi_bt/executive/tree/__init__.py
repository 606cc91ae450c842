"""Trees as specs: YAML, checks, compiling plans, building nodes."""
