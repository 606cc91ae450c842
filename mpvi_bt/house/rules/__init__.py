"""How states of things change that are no motion: heat, marks, cuts, mounts, grains. Pure functions, no simulator.

The rules are OmniGibson's, which BEHAVIOR's goals are judged by; `tests/fixtures/rules/` has cases of each with the
place that they come from. One file a rule: whoever adds one of another task adds a file here and one of cases.
"""
