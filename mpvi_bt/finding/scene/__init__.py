"""What is known of the world: things, what hands hold, maps. Seen by cameras, or known by truth; one interface."""
