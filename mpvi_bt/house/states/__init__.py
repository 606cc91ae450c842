"""States of things that are no motion, such as heat, marks, cuts and mounts: one file a state, and no simulator.

A file has the rule, as pure functions, and below it what becomes of the things in a world by it, step by step: they are
known by the protocols of `in_world.py` and `world_state.py`. `sim` implements these, and draws what cameras see.

The rules are OmniGibson's, which BEHAVIOR's goals are judged by; `tests/fixtures/rules/` has cases of each with the
place that they come from. Whoever adds a state adds a file here and one of cases.
"""
