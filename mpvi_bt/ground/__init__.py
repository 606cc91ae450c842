"""The base of every wing: errors, files, protocols, geometry and robots."""
