"""Surface velocity from two surveys: hillshades, template matching, and fields of displacements."""
