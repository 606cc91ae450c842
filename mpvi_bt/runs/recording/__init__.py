"""Subscribers of the loop that record it: traces, films, pictures, demonstrations."""
