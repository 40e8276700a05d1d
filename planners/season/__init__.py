"""Design of a season: swaths, stakes and days for a wanted error of the mass balance between two dates."""
