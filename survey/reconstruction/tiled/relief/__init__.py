"""Relief of a large survey: long wavelengths over the entire map, the rest tile by tile."""
