"""What a run chooses (policy, detector, checker, planner, map, simulator), and the makers of each."""
