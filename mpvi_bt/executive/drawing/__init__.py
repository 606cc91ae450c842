"""Trees as text, Mermaid, DOT and SVG, from their specs."""
