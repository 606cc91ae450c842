"""A classical planner: a plan for any task with a goal, without a model, a key or a plan on file."""
