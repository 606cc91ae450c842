"""What every wing stands on: errors, files, protocols, geometry, and what a robot is."""
