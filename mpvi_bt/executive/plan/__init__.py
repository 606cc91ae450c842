"""Plans: their form, the skills they call, and the planners that make them."""
