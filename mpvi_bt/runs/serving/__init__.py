"""Episodes driven from outside: the executive behind a socket, evaluators and benchmarks."""
