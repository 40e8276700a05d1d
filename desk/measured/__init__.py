"""Real measurements: their files, the map made from them, its score, and the swath to drive next."""
