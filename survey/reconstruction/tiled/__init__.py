"""Maps of surveys that do not fit the memory: points sorted to tiles, strip errors, relief tile by tile."""
