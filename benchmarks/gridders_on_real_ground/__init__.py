"""Maps of real ground beside those of other gridders."""
