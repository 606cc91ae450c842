"""Policies over the wire: the codec, the mapping of observations and actions, clients, and the server."""
