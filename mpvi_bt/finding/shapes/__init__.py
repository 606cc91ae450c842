"""From points in the world to solids: boxes, cylinders, vessels, furniture, doors, lids."""
