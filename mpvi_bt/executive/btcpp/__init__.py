"""Trees in BehaviorTree.CPP's XML, both ways."""
