"""Eyes: pictures to learn from, and how well a network sees in houses that it was not trained in."""
