"""What a person or an agent touches: commands, pages, tools, and the calls in Python."""
