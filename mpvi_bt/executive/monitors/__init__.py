"""Telling from actions and proprioception alone that a policy is failing, whatever policy it is."""
