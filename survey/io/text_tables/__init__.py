"""Text tables of other programs: separators, decimal commas, and usual names of columns."""
