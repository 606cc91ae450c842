"""Plans rehearsed before they run: carried out on paper, on what is known of the start."""
