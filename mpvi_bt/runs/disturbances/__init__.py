"""What a real robot's parts do to a run and a simulated run lacks: answers that come late, policies that fail."""
