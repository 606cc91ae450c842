"""Knowledge of the world: things, payloads, maps. Seen by cameras, or known by truth; one interface."""
