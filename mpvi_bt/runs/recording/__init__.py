"""Subscribers of the loop that keep what they see: traces, films, pictures, demonstrations."""
